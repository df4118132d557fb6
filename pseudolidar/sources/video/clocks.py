"""When the frames of videos were taken: by files of times, by the videos, or made up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pseudolidar.errors import UsageError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.time_table import read_time_table
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.sources.stamps import (
    TIMES_FILES,
    FrameTimes,
    read_frame_times,
    recorded_times,
    synthetic_times,
)
from pseudolidar.structures.arrays import Int64

if TYPE_CHECKING:
    from pseudolidar.formats.video.file import VideoFile


@dataclass(frozen=True)
class VideoClocks:
    """What the times of frames follow from.

    Args:
        path: video, or folder with the videos, where a file of times may lie.
        times: file with a time for each frame of the (left) video.
        right_times: the same for the right video.
        right_delay_s: added to the times of the right video before pairing.
        rate_hz: frames a second, where nothing has times.
        limits: caps on the files.
    """

    path: Path
    times: Path | None
    right_times: Path | None
    right_delay_s: float
    rate_hz: float
    limits: Limits

    def of_both(self, left: VideoFile, right: VideoFile) -> tuple[Sequence[int], Sequence[int]]:
        """Times of all frames of both videos, ns, to pair them by.

        Raises:
            UsageError: times of the right video alone.
            SequenceTime: a file of times that does not fit.
        """
        lefts: Sequence[int] = left.timestamps_ns
        rights: Sequence[int] = right.timestamps_ns
        if self.right_times is not None:
            if self.times is None:
                raise UsageError(
                    "times of the right video alone", want="--times as well", where="--right-times"
                )
            lefts, rights = self._listed(self.times, left), self._listed(self.right_times, right)
        delay_ns = round(self.right_delay_s * NS_PER_S)
        return lefts, [time_ns + delay_ns for time_ns in rights]

    def of(self, video: VideoFile, numbers: Int64) -> FrameTimes:
        """Times of the frames `numbers`, after zero: of a file, of the video, or made up.

        Raises:
            SequenceTime: a file of times that does not fit.
        """
        file = self._file()
        if file is not None:
            entries = read_time_table(file, limits=self.limits)
            times = read_frame_times(file, entries.stamps_ns, numbers.tolist())
            times = replace(times, notes=(replace(entries, names=None).note, *times.notes))
            return times if times.timestamps_ns[0] > 0 else times.after_zero()
        if not video.index.timed:
            return synthetic_times(numbers.tolist(), self.rate_hz)
        stamps_ns = [video.timestamps_ns[number] for number in numbers]
        return recorded_times(stamps_ns, first_ns=video.timestamps_ns[0])

    def _listed(self, file: Path, video: VideoFile) -> Sequence[int]:
        stamps_ns = read_time_table(file, limits=self.limits).stamps_ns
        return read_frame_times(file, stamps_ns, range(len(video))).timestamps_ns

    def _file(self) -> Path | None:
        if self.times is not None:
            return self.times
        places = (self.path / name for name in TIMES_FILES) if self.path.is_dir() else ()
        return next((place for place in places if place.is_file()), None)
