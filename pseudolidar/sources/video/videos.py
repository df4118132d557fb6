"""Videos of two eyes: two files, or one in which both are packed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.errors import (
    PairMismatch,
    PseudolidarError,
    SourceUnknown,
    VideoDamaged,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_folder import find_rig
from pseudolidar.formats.rigs.rig_json import missing_rig
from pseudolidar.formats.rigs.rig_reading import Pictures, RigReading, RigUnit
from pseudolidar.formats.video.kind import video_kind
from pseudolidar.sources.rig_size import fitting_rig
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.stamps import FrameTimes
from pseudolidar.sources.video.clocks import VideoClocks
from pseudolidar.sources.video.frames import VideoSource
from pseudolidar.sources.video.packing import (
    Layout,
    Packing,
    find_packing,
    size_text,
)
from pseudolidar.sources.video.pairing import (
    eyes_among,
    pair_moments,
    partner_of,
    videos_in,
)

if TYPE_CHECKING:
    from pseudolidar.formats.video.file import VideoFile


@dataclass(frozen=True)
class Video:
    """Two videos, or one with both eyes side by side or one above the other.

    Two videos are found by name in a folder or beside the one that is given: `left.mp4` and
    `right.mp4`, `x_l.mkv` and `x_r.mkv`, `cam_0.avi` and `cam_1.avi`. Their frames are paired by
    time; frames of one eye alone are left out and reported. How one video is packed follows from
    the size of an eye in its rig (`rig.json` beside it): twice as wide is side by side, twice as
    high is top and bottom.

    Args:
        path: video, or folder with the videos; of the left eye if `right` is given.
        right: video of the right eye.
        rig: calibration of one eye's size, of any known form; else the one beside the video, such
            as `rig.json`.
        layout: how both eyes are packed in one video, where the rig's size does not tell.
        swap: the right eye comes first (left half, upper half).
        times: file with a time for each frame (of the left video): seconds, dates, nanoseconds.
        right_times: the same for the right video; the eyes are then paired by these.
        rate_hz: frames a second, where the video has no times.
        tolerance_s: frames are paired up to this difference; by default a quarter of the interval,
            at most 10 ms.
        right_delay_s: added to the times of the right video before pairing.
        as_stored: do not turn pictures although the video says so.
        scale_calibration: scale the rig where pictures have another size.
        rig_unit: unit of lengths in calibrations that do not say it.
        pictures: raw or rectified, where a calibration knows both.
        limits: caps on the files.
    """

    path: str
    right: str | None = None
    rig: str | None = None
    layout: Layout | None = None
    swap: bool = False
    times: str | None = None
    right_times: str | None = None
    rate_hz: float = 10.0
    tolerance_s: float | None = None
    right_delay_s: float = 0.0
    as_stored: bool = False
    scale_calibration: bool = False
    rig_unit: RigUnit | None = None
    pictures: Pictures = "auto"
    limits: Limits = DEFAULT_LIMITS

    def open(self) -> VideoSource:
        """Index the videos, read the rig, pair the frames; the first frames are decoded.

        Raises:
            SourceUnknown: no video; several pairs of them; one whose packing is not known.
            VideoUnreadable: a file that is no whole video.
            CalibrationMissing, NotRectified: no usable rig.
            CalibrationSizeMismatch: an eye has another size than the rig.
            PairMismatch: the two videos differ in size.
            SourceEmpty: no two frames are of one moment.
            SequenceTime: the file of times does not fit.
        """
        left, right, rule = self._files()
        reading = self._rig(left)
        if right is None:
            return self._packed(self._opened(left), reading)
        return self._two(self._opened(left), self._opened(right), rule, reading)

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` is a video, or a folder with videos of two eyes or with one video."""
        if not path.is_dir():
            return video_kind(path) is not None
        videos = videos_in(path)
        return len(videos) == 1 or bool(eyes_among(videos))

    def _files(self) -> tuple[Path, Path | None, str]:
        """Left and right video and how they were found; one that holds both eyes alone."""
        path = Path(self.path)
        if self.right is not None:
            return path, Path(self.right), "as given"
        if not path.is_dir():
            beside = partner_of(path) if self.layout is None else None
            return beside or (path, None, "")
        videos = videos_in(path)
        pairs = eyes_among(videos)
        if len(pairs) == 1 and self.layout is None:
            return pairs[0]
        if len(videos) == 1:
            return videos[0], None, ""
        names = ", ".join(video.name for video in videos[:6])
        raise SourceUnknown(
            f"{len(videos)} videos and {len(pairs)} pairs of them: {names or 'none'}",
            want="one video, or two named left and right, _l and _r, _0 and _1",
            fix="Give the left video, and the right one by --right.",
            path=path,
        )

    def _opened(self, path: Path) -> VideoFile:
        from pseudolidar.formats.video.file import VideoFile

        return VideoFile.open(path, rotated=not self.as_stored, limits=self.limits)

    def _rig(self, video: Path) -> RigReading:
        file = find_rig(video.parent) if self.rig is None else Path(self.rig)
        if file is None:
            raise missing_rig(video.parent / "rig.json")
        reading = read_any_rig(file, unit=self.rig_unit, limits=self.limits)
        return reading.taken_for(self.pictures)

    @property
    def _clocks(self) -> VideoClocks:
        return VideoClocks(
            Path(self.path),
            times=None if self.times is None else Path(self.times),
            right_times=None if self.right_times is None else Path(self.right_times),
            right_delay_s=self.right_delay_s,
            rate_hz=self.rate_hz,
            limits=self.limits,
        )

    def _packed(self, video: VideoFile, reading: RigReading) -> VideoSource:
        packing = find_packing(
            video,
            reading.of_pictures,
            layout=self.layout,
            swap=self.swap,
            scale_calibration=self.scale_calibration,
        )
        numbers = np.arange(len(video), dtype=np.int64)
        times = self._clocks.of(video, numbers)
        return VideoSource(
            summary=self._summary(
                f"{packing.layout} video {video.path.name}: {len(video)} pairs",
                video,
                times,
                (*packing.notes, *video.notes, *reading.notes),
            ),
            ids=tuple(f"{n:06d}" for n in numbers),
            timestamps_ns=times.timestamps_ns,
            refused=_lost(video),
            left=video,
            right=None,
            left_frames=numbers,
            right_frames=numbers,
            packing=packing,
            rig=packing.rig,
        )

    def _two(
        self, left: VideoFile, right: VideoFile, rule: str, reading: RigReading
    ) -> VideoSource:
        if self.swap:
            left, right = right, left
        rig = reading.of_pictures
        if left.size_px != right.size_px and rig.left.size_px == rig.right.size_px:
            raise PairMismatch(
                f"left video of {size_text(left)}, right one of {size_text(right)}",
                want="the same size",
                fix="Check that both are of one recording.",
                path=right.path,
            )
        clocks = self._clocks
        moments = pair_moments(
            *clocks.of_both(left, right),
            tolerance_s=self.tolerance_s,
            files=(left.path, right.path),
        )
        times = clocks.of(left, moments.left)
        rig = fitting_rig(
            rig,
            left.size_px,
            scale_calibration=self.scale_calibration,
            path=left.path,
        )
        packing = Packing(None, False, rig)
        alone = f"{len(moments.alone)} frames of one eye alone left out" if moments.alone else ""
        notes = (
            f"eyes: {rule}, frames paired by time within {moments.tolerance_ns / 1e6:.3g} ms "
            f"(largest difference {moments.largest_ns / 1e6:.3g} ms)",
            *([alone] if alone else []),
            *dict.fromkeys(left.notes + right.notes),
        )
        line = f"two videos, {left.path.name} and {right.path.name}: {len(moments.ids)} pairs"
        return VideoSource(
            summary=self._summary(line, left, times, (*notes, *reading.notes)),
            ids=moments.ids,
            timestamps_ns=times.timestamps_ns,
            refused=(*moments.alone, *_lost(left)),
            left=left,
            right=right,
            left_frames=moments.left,
            right_frames=moments.right,
            packing=packing,
            rig=packing.rig,
        )

    def _summary(
        self,
        line: str,
        video: VideoFile,
        times: FrameTimes,
        notes: Sequence[str],
    ) -> SourceSummary:
        return SourceSummary(
            kind="video",
            path=self.path,
            line=f"{line}, {video.index.codec} in {video.index.container}, {_rate(times)}",
            notes=(*notes, *times.notes),
        )


def _lost(video: VideoFile) -> tuple[tuple[str, PseudolidarError], ...]:
    """What the file claims to hold and does not, as one frame that is refused."""
    lost = video.index.promised - video.index.packets
    if lost <= 0:
        return ()
    error = VideoDamaged(
        f"this frame and the {lost - 1} after it are not in the file",
        want=f"{video.index.promised} frames, as its directory says",
        fix="Copy the file again.",
        path=video.path,
    )
    return ((f"{len(video):06d}", error),)


def _rate(times: FrameTimes) -> str:
    steps = np.diff(np.array(times.timestamps_ns, np.float64)) / 1e9
    return f"{1 / np.median(steps):.4g} frames/s" if len(steps) else "one frame"
