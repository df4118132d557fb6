"""Times of a sequence's frames: read, checked, or made up and said so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import SequenceTime, UsageError
from pseudolidar.formats.timestamps import NS_PER_S

# Frames without times start here: a stamp of 0 means "no time" to many tools.
START_NS = NS_PER_S
# Files beside pictures and videos that are looked for their times.
TIMES_FILES = (
    "times.txt",
    "timestamps.txt",
    "times.csv",
    "timestamps.csv",
    "data.csv",
    "rgb.txt",
)
# A gap beyond this multiple of the median interval is told.
GAP_RATIO = 3.0


@dataclass(frozen=True)
class FrameTimes:
    """Times of frames.

    Args:
        timestamps_ns: by frame.
        notes: where they come from, if not from the data; gaps.
    """

    timestamps_ns: tuple[int, ...]
    notes: tuple[str, ...] = ()

    def after_zero(self) -> FrameTimes:
        """Times that count from the start of the sequence, moved to start at 1 s."""
        note = "time: seconds from the start of the sequence, plus 1 s"
        return FrameTimes(
            tuple(stamp_ns + START_NS for stamp_ns in self.timestamps_ns), (*self.notes, note)
        )


def synthetic_times(indices: Sequence[int], rate_hz: float) -> FrameTimes:
    """1 s + index / rate, for sources without times.

    Raises:
        UsageError: the rate is not positive.
    """
    if not rate_hz > 0:
        raise UsageError(f"a rate of {rate_hz:g} Hz", want="above 0", where="rate_hz")
    stamps = tuple(START_NS + round(index * NS_PER_S / rate_hz) for index in indices)
    return FrameTimes(stamps, (f"time: synthetic, 1 s + index / {rate_hz:g} Hz",))


def recorded_times(stamps_ns: Sequence[int], *, first_ns: int) -> FrameTimes:
    """Times that a recording states; where it begins at 0 or before, moved to begin at 1 s.

    Args:
        stamps_ns: increasing, of the chosen frames.
        first_ns: time of the recording's first frame, chosen or not.
    """
    gaps = _gap_note(list(stamps_ns), range(len(stamps_ns)))
    if first_ns > 0:
        return FrameTimes(tuple(stamps_ns), gaps)
    note = "time: of the recording, moved to begin at 1 s"
    moved = tuple(stamp_ns - first_ns + START_NS for stamp_ns in stamps_ns)
    return FrameTimes(moved, (note, *gaps))


def read_frame_times(
    path: Path, stamps_ns: Sequence[int | None], numbers: Sequence[int]
) -> FrameTimes:
    """Times of the frames `numbers` in a file whose line n (from 0) belongs to frame n.

    A blank line holds the place of a missing frame; where it falls on a frame that is there,
    blank lines are taken for padding.

    Args:
        path: the file, for errors.
        stamps_ns: its lines, None where blank.
        numbers: increasing frame numbers.

    Raises:
        SequenceTime: fewer stamps than frames, or stamps that do not increase, by first index.
    """
    last = max(numbers, default=-1)
    lines = list(stamps_ns)
    if any(number >= len(lines) or lines[number] is None for number in numbers):
        lines = [stamp for stamp in lines if stamp is not None]
    if len(lines) <= last:
        raise SequenceTime(
            f"{len(lines)} stamps",
            want=f"at least {last + 1}, as there is a frame {last}",
            fix="Copy the file again, or remove it to number the frames by --rate.",
            path=path,
            where=f"index {len(lines)}",
        )
    # Each of `numbers` has a stamp now, whether blanks hold places or not.
    chosen = [stamp for number in numbers if (stamp := lines[number]) is not None]
    _check_increasing(path, chosen, numbers)
    return FrameTimes(tuple(chosen), _gap_note(chosen, numbers))


def _check_increasing(path: Path, stamps_ns: list[int], numbers: Sequence[int]) -> None:
    for index in range(1, len(stamps_ns)):
        step_ns = stamps_ns[index] - stamps_ns[index - 1]
        if step_ns <= 0:
            raise SequenceTime(
                f"frame {numbers[index]} is {-step_ns / NS_PER_S:.9g} s before the one before it"
                if step_ns
                else f"frame {numbers[index]} has the same time as the one before it",
                want="increasing times",
                fix="Correct the file, or remove it to number the frames by --rate.",
                path=path,
                where=f"index {index}",
            )


def _gap_note(stamps_ns: list[int], numbers: Sequence[int]) -> tuple[str, ...]:
    if len(stamps_ns) < 3:
        return ()
    # Per number, so that frames left out on purpose are no gap.
    steps = np.diff(np.array(stamps_ns)) / np.diff(np.array(numbers))
    median = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP_RATIO * median)
    if not len(gaps):
        return ()
    index = int(gaps[0]) + 1
    return (
        f"time: {len(gaps)} gap(s) above {GAP_RATIO:g} times the median of {median / 1e9:.3g} s, "
        f"the first at index {index}",
    )
