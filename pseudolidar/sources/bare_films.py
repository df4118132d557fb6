"""Films of two cameras that nobody has calibrated yet: two videos, or one with both eyes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.errors import SourceUnknown
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.video.kind import video_kind
from pseudolidar.sources.bare_pairs import BarePairs, Pictures, ReadPair
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.video.packing import AXES, STEREO_MODES, Layout, size_text
from pseudolidar.sources.video.pairing import eyes_among, pair_moments, partner_of, videos_in
from pseudolidar.structures.arrays import Image

if TYPE_CHECKING:
    from pseudolidar.formats.video.file import VideoFile

# Pictures of one eye are between square and twice as wide as high: a wider one holds two eyes.
WIDEST_EYE, NARROWEST_EYE = 2.2, 0.95


@dataclass(frozen=True)
class Films:
    """Two videos, or one with both eyes side by side or one above the other.

    Args:
        path: video, or folder with the videos; of the left eye if `right` is given.
        right: video of the right eye.
        layout: how both eyes are packed in one video, where its shape does not tell.
        tolerance_s: frames are paired up to this difference; by default a quarter of the interval,
            at most 10 ms.
        right_delay_s: added to the times of the right video before pairing.
        limits: caps on the files.
    """

    path: str
    right: str | None = None
    layout: Layout | None = None
    tolerance_s: float | None = None
    right_delay_s: float = 0.0
    limits: Limits = DEFAULT_LIMITS

    def open(self) -> BarePairs:
        """Index the videos and pair their frames by time.

        Raises:
            SourceUnknown: no video, or several pairs of them.
            VideoUnreadable: a file that is no whole video.
            SourceEmpty: no two frames are of one moment.
        """
        left, right = self._files()
        return self._packed(self._opened(left)) if right is None else self._two(left, right)

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` is a video, or a folder with those of two eyes or with one."""
        if not path.is_dir():
            return video_kind(path) is not None
        videos = videos_in(path)
        return len(videos) == 1 or bool(eyes_among(videos))

    def _files(self) -> tuple[Path, Path | None]:
        path = Path(self.path)
        if self.right is not None:
            return path, Path(self.right)
        if not path.is_dir():
            beside = partner_of(path) if self.layout is None else None
            return (beside[0], beside[1]) if beside else (path, None)
        videos = videos_in(path)
        pairs = eyes_among(videos)
        if len(pairs) == 1 and self.layout is None:
            return pairs[0][0], pairs[0][1]
        if len(videos) == 1:
            return videos[0], None
        raise SourceUnknown(
            f"{len(videos)} videos and {len(pairs)} pairs of them",
            want="one video, or two named left and right, _l and _r, _0 and _1",
            fix="Give the left video, and the right one by --right.",
            path=path,
        )

    def _opened(self, path: Path) -> VideoFile:
        from pseudolidar.formats.video.file import VideoFile

        return VideoFile.open(path, limits=self.limits)

    def _two(self, left_path: Path, right_path: Path) -> BarePairs:
        left, right = self._opened(left_path), self._opened(right_path)
        delay_ns = round(self.right_delay_s * 1e9)
        moments = pair_moments(
            left.timestamps_ns,
            [time_ns + delay_ns for time_ns in right.timestamps_ns],
            tolerance_s=self.tolerance_s,
            files=(left.path, right.path),
        )

        def read(number: int) -> tuple[Image, Image]:
            return (
                left.picture(int(moments.left[number])).pixels,
                right.picture(int(moments.right[number])).pixels,
            )

        line = f"two videos, {left.path.name} and {right.path.name}: {len(moments.ids)} pairs"
        return self._pairs(line, moments.ids, read, tuple(dict.fromkeys(left.notes + right.notes)))

    def _packed(self, video: VideoFile) -> BarePairs:
        layout, swapped = self._layout(video)

        def read(number: int) -> tuple[Image, Image]:
            pixels = video.picture(number).pixels
            first, second = (
                np.ascontiguousarray(half) for half in np.array_split(pixels, 2, axis=AXES[layout])
            )
            return (second, first) if swapped else (first, second)

        line = f"{layout} video {video.path.name}: {len(video)} pairs"
        return self._pairs(line, tuple(f"{n:06d}" for n in range(len(video))), read, video.notes)

    def _layout(self, video: VideoFile) -> tuple[Layout, bool]:
        if self.layout is not None:
            return self.layout, False
        if video.stereo in STEREO_MODES:
            return STEREO_MODES[video.stereo]
        shape = video.size_px[0] / video.size_px[1]
        if shape > WIDEST_EYE:
            return "side-by-side", False
        if shape < NARROWEST_EYE:
            return "top-bottom", False
        raise SourceUnknown(
            f"one video of {size_text(video)}",
            want="two videos, or one with both eyes",
            fix="Give the right eye's video by --right, or name how the eyes are packed: "
            "--layout side-by-side.",
            path=video.path,
        )

    def _pairs(
        self, line: str, ids: tuple[str, ...], read: ReadPair, notes: tuple[str, ...]
    ) -> BarePairs:
        summary = SourceSummary(kind="films", path=self.path, line=line, notes=notes)
        return BarePairs(summary, ids, (), read, film=True)


BareSource = Pictures | Films


def recognise_bare(text: str) -> Pictures | Films:
    """Pictures or films of two eyes, by what is in the folder."""
    path = Path(text)
    if not Pictures.looks_like(path) and path.exists() and Films.looks_like(path):
        return Films(text)
    return Pictures(text)
