"""Which pictures of an unsynchronised drive belong together: by their times, not their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import PairMismatch, PseudolidarError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.timestamps import NS_PER_S, read_timestamps
from pseudolidar.sources.kitti.parts import CameraFolders
from pseudolidar.sources.numbered import FrameNumber, NumberedFiles, pair_by_number
from pseudolidar.sources.stamps import read_frame_times, synthetic_times
from pseudolidar.sources.timed_pairs import associate

TIMES = "timestamps.txt"


@dataclass(frozen=True)
class TimedPair:
    """Two pictures of about one moment.

    Args:
        number: of the left picture.
        left: its file.
        right: file of the right one, whose number may be another.
        timestamp_ns: time of the left one.
    """

    number: FrameNumber
    left: Path
    right: Path
    timestamp_ns: int


@dataclass(frozen=True)
class TimedPairs:
    """The pairs of a drive.

    Args:
        pairs: in order of time.
        refused: id and reason of each picture that has no partner.
        notes: how they were paired, and what is odd.
    """

    pairs: tuple[TimedPair, ...]
    refused: tuple[tuple[str, PseudolidarError], ...]
    notes: tuple[str, ...]


def timed_pairs(
    cameras: CameraFolders, *, max_skew_s: float, rate_hz: float, limits: Limits
) -> TimedPairs:
    """Pair the pictures of two cameras by the times that each camera has in its own file.

    Where one of the files is missing, equal numbers are taken for pairs, and that is noted.

    Args:
        cameras: folders of both eyes.
        max_skew_s: eyes whose times differ by more are no pair.
        rate_hz: frames a second where there are no times.
        limits: caps on the files of times.

    Raises:
        SequenceTime: lines that are no dates, fewer than pictures, or not increasing.
    """
    left_times, right_times = (eye.folder.parent / TIMES for eye in (cameras.left, cameras.right))
    if left_times.is_file() and right_times.is_file():
        return _by_time(cameras, (left_times, right_times), max_skew_s, limits)
    by_number = pair_by_number(cameras.left, cameras.right)
    numbers = [number for number, _, _ in by_number.pairs]
    indices = [number[0] for number in numbers]
    if left_times.is_file():
        times = read_frame_times(left_times, read_timestamps(left_times, limits=limits), indices)
    else:
        times = synthetic_times([index - indices[0] for index in indices], rate_hz)
    absent = right_times if left_times.is_file() else left_times
    note = f"eyes are paired by their numbers: no {absent.parent.name}/{TIMES}"
    pairs = tuple(
        TimedPair(*files, stamp_ns)
        for files, stamp_ns in zip(by_number.pairs, times.timestamps_ns, strict=True)
    )
    return TimedPairs(pairs, by_number.refused, (note, *by_number.notes, *times.notes))


def _by_time(
    cameras: CameraFolders, times: tuple[Path, Path], max_skew_s: float, limits: Limits
) -> TimedPairs:
    eyes = cameras.left, cameras.right
    (lefts, left_ns), (rights, right_ns) = (
        _stamped(eye, path, limits) for eye, path in zip(eyes, times, strict=True)
    )
    found = associate(left_ns, right_ns, tolerance_ns=round(max_skew_s * NS_PER_S))
    pairs = tuple(
        TimedPair(
            lefts[i], cameras.left.paths[lefts[i]], cameras.right.paths[rights[j]], left_ns[i]
        )
        for i, j in found
    )
    paired = {i for i, _ in found}, {j for _, j in found}
    refused = [
        (cameras.left.paths[lefts[i]].stem, _alone(left_ns[i], right_ns, "right", max_skew_s))
        for i in range(len(lefts))
        if i not in paired[0]
    ]
    names = {name for name, _ in refused} | {pair.left.stem for pair in pairs}
    for j in range(len(rights)):
        stem = cameras.right.paths[rights[j]].stem
        if j not in paired[1] and stem not in names:
            refused.append((stem, _alone(right_ns[j], left_ns, "left", max_skew_s)))
    other = sum(lefts[i] != rights[j] for i, j in found)
    notes = [f"eyes are paired by time, up to {max_skew_s * 1e3:g} ms apart"]
    if found:
        apart_ms = [abs(right_ns[j] - left_ns[i]) / 1e6 for i, j in found]
        notes[0] += f"; those of the pairs are {max(apart_ms):.2g} ms apart at most"
    if other:
        notes.append(f"{other} of {len(found)} pairs have eyes of different numbers")
    notes += [note for eye in eyes for note in eye.notes()]
    return TimedPairs(pairs, tuple(sorted(refused, key=lambda item: item[0])), tuple(notes))


def _stamped(
    files: NumberedFiles, path: Path, limits: Limits
) -> tuple[list[FrameNumber], tuple[int, ...]]:
    """Numbers of the pictures of one eye, and their times."""
    numbers = sorted(files.paths)
    lines = read_timestamps(path, limits=limits)
    return numbers, read_frame_times(path, lines, [n[0] for n in numbers]).timestamps_ns


def _alone(stamp_ns: int, others_ns: Sequence[int], other: str, max_skew_s: float) -> PairMismatch:
    nearest_ms = min((abs(other_ns - stamp_ns) / 1e6 for other_ns in others_ns), default=None)
    got = f"no {other} picture"
    if nearest_ms is not None:
        got = f"the nearest {other} picture is {nearest_ms:.3g} ms away"
        if nearest_ms <= max_skew_s * 1e3:
            got += ", and belongs to another"
    return PairMismatch(
        got,
        want=f"a {other} picture up to {max_skew_s * 1e3:g} ms away",
        fix="Where the scene stands still in that time, raise --max-skew (seconds).",
    )
