"""Which scan of a KITTI raw drive belongs to which picture, and when it was taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.timestamps import read_timestamps
from pseudolidar.sources.numbered import FrameNumber, NumberedFiles


@dataclass(frozen=True)
class TimedScan:
    """A scan of a drive.

    Args:
        path: its file.
        timestamp_ns: when the LiDAR faced forward, where that is known.
        turn_ns: when the turn began and ended, where that is known.
    """

    path: Path
    timestamp_ns: int | None = None
    turn_ns: tuple[int, int] | None = None


@dataclass(frozen=True)
class ScanTimes:
    """Lines of the three files of times beside the scans; empty where a file is absent.

    Args:
        forward_ns: `timestamps.txt`.
        begin_ns: `timestamps_start.txt`.
        end_ns: `timestamps_end.txt`.
        notes: what is wrong with the last two. They only tell when single points were taken, so
            that scans stay as they are stored without them.
    """

    forward_ns: Sequence[int | None] = ()
    begin_ns: Sequence[int | None] = ()
    end_ns: Sequence[int | None] = ()
    notes: tuple[str, ...] = ()

    @classmethod
    def read(cls, folder: Path, limits: Limits) -> ScanTimes:
        """Those of `velodyne_points`.

        Raises:
            SequenceTime: a line of `timestamps.txt` that is no date.
        """
        forward, begin, end = (folder / f"timestamps{name}.txt" for name in ("", "_start", "_end"))
        try:
            return cls(_stamps(forward, limits), _stamps(begin, limits), _stamps(end, limits))
        except PseudolidarError as error:
            note = f"warning: scans are not moved to one moment: {error}"
            return cls(_stamps(forward, limits), notes=(note,))

    def of(self, number: FrameNumber, path: Path) -> TimedScan:
        """The scan of this number."""
        forward, begin, end = (
            stamps[number[0]] if number[0] < len(stamps) else None
            for stamps in (self.forward_ns, self.begin_ns, self.end_ns)
        )
        turn_ns = None
        if begin is not None and end is not None and begin < end:
            turn_ns = begin, end
        return TimedScan(path, forward, turn_ns)


def _stamps(path: Path, limits: Limits) -> tuple[int | None, ...]:
    """Of a file; none where it is absent."""
    return read_timestamps(path, limits=limits) if path.is_file() else ()


def scans_of_pictures(
    scans: NumberedFiles,
    times: ScanTimes,
    numbers: Sequence[FrameNumber],
    stamps_ns: Sequence[int],
) -> dict[FrameNumber, FrameNumber]:
    """Number of the scan by number of the picture: the nearest in time, else the same number.

    Synchronised drives number both alike. In others the LiDAR begins earlier or later than the
    cameras, or drops a turn, and equal numbers are of different moments.

    Args:
        scans: all of them.
        times: theirs; used where every scan has one, they increase, and the pictures' clock shows
            them, too.
        numbers: of the pictures.
        stamps_ns: times of the pictures.

    Returns:
        Without pictures that have no scan: none of their number, or none within half a turn.
    """
    by_number = {number: number for number in numbers if number in scans.paths}
    ordered = sorted(scans.paths)
    stamps = [times.forward_ns[n[0]] if n[0] < len(times.forward_ns) else None for n in ordered]
    known = [stamp for stamp in stamps if stamp is not None]
    if len(known) < max(2, len(ordered)):
        return by_number
    taken_ns = np.array(known, np.int64)
    steps_ns = np.diff(taken_ns) / np.diff([number[0] for number in ordered])  # of a turn
    if (steps_ns <= 0).any():
        return by_number
    wanted_ns = np.array(stamps_ns, np.int64)
    after = np.clip(np.searchsorted(taken_ns, wanted_ns), 1, len(taken_ns) - 1)
    before_nearer = wanted_ns - taken_ns[after - 1] <= taken_ns[after] - wanted_ns
    place = np.where(before_nearer, after - 1, after)
    near = np.abs(taken_ns[place] - wanted_ns) <= np.median(steps_ns) / 2
    by_time = {
        number: ordered[index]
        for number, index, ok in zip(numbers, place.tolist(), near.tolist(), strict=True)
        if ok
    }
    return by_time or by_number


def numbered(offset: int) -> str:
    """The number of the scan of picture n, in words: n, n - 2, n + 2."""
    return "n" if not offset else f"n {'-' if offset > 0 else '+'} {abs(offset)}"


def renumbered_note(scan_of: Mapping[FrameNumber, FrameNumber]) -> tuple[str, ...]:
    """What to say where scans have another number than their picture."""
    other = sum(picture != scan for picture, scan in scan_of.items())
    if not other:
        return ()
    return (f"velodyne: scans by time, {other} of {len(scan_of)} have another number",)
