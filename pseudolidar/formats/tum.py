"""Text files of TUM's RGB-D data: lists of pictures with times, associations, trajectories."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from pseudolidar.errors import PoseFileError, SequenceTime
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import TextLine, Word, read_lines
from pseudolidar.formats.timestamps import LARGEST_S, NS_PER_S
from pseudolidar.geometry.quaternion import quaternion_wxyz, rotations_of
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import ROTATION_TOLERANCE

TRAJECTORY_NUMBERS = 8
NOT_SECONDS = "Divide the times by 1e9 if they are nanoseconds."


@dataclass(frozen=True)
class TimedName:
    """A line of `rgb.txt` or `depth.txt`.

    Args:
        time_ns: time of the picture.
        name: path of the picture, relative to the list.
    """

    time_ns: int
    name: str


def read_picture_list(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[TimedName, ...]:
    """Read `rgb.txt` or `depth.txt`: `seconds path` by line, `#` begins a comment.

    Raises:
        SequenceTime: missing file, no time, no path; by line.
    """
    return tuple(_timed(line, line.words()[:2]) for line in _content(path, SequenceTime, limits, 2))


def read_associations(
    path: Path, *, limits: Limits = DEFAULT_LIMITS
) -> tuple[tuple[TimedName, TimedName], ...]:
    """Read `associations.txt`: `seconds path seconds path` by line, in the order of the file.

    Raises:
        SequenceTime: as `read_picture_list`.
    """
    lines = _content(path, SequenceTime, limits, 4)
    return tuple(
        (_timed(line, line.words()[:2]), _timed(line, line.words()[2:4])) for line in lines
    )


def _content(
    path: Path, error: type[SequenceTime] | type[PoseFileError], limits: Limits, words: int
) -> list[TextLine]:
    found = []
    for line in read_lines(path, error=error, limits=limits):
        if not line.text.strip() or line.text.lstrip().startswith("#"):
            continue
        if len(line.words()) < words:
            raise line.refusal(f"{len(line.words())} words", want=str(words))
        found.append(line)
    return found


def _timed(line: TextLine, words: list[Word]) -> TimedName:
    return TimedName(_time_ns(line, words[0]), words[1].text)


def _time_ns(line: TextLine, word: Word) -> int:
    """Seconds to whole nanoseconds, exact."""
    if not 0 <= line.number_of(word) < LARGEST_S:
        raise line.refusal(
            f"{word.text[:40]!r} s", want="seconds", fix=NOT_SECONDS, column=word.column
        )
    return int((Decimal(word.text) * NS_PER_S).to_integral_value())


def read_tum_trajectory(
    path: Path, *, limits: Limits = DEFAULT_LIMITS
) -> tuple[tuple[int, ...], Float64]:
    """Read a trajectory: `seconds tx ty tz qx qy qz qw` by line.

    Returns:
        Times, ns, and (N, 4, 4) `T_world_camera`, metres.

    Raises:
        PoseFileError: missing file, no number, wrong count, a quaternion that is none; by line.
    """
    times: list[int] = []
    values: list[list[float]] = []
    for line in _content(path, PoseFileError, limits, 1):
        words = line.words()
        numbers = line.numbers(words, count=TRAJECTORY_NUMBERS)
        length = math.hypot(*numbers[4:])
        # Written with four digits, a quaternion is of unit length to some 1e-4.
        if not abs(length - 1) <= ROTATION_TOLERANCE:
            raise line.refusal(f"a quaternion of length {length:.4g}", want="1, to 1e-3")
        times.append(_time_ns(line, words[0]))
        values.append(numbers[1:])
    rows = np.array(values, np.float64).reshape(-1, TRAJECTORY_NUMBERS - 1)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotations_of(rows[:, [6, 3, 4, 5]]), rows[:, :3]
    return tuple(times), poses


def write_tum_trajectory(
    path: Path,
    times_ns: Sequence[int],
    T_world_camera: Float64,
    *,
    comments: Sequence[str] = (),
) -> None:
    """Write (N, 4, 4) poses as a trajectory, times exact, numbers with all digits.

    Args:
        path: of the file.
        times_ns: of the poses.
        T_world_camera: them.
        comments: lines for people, before the poses.
    """
    rows = [f"# {comment}" for comment in comments]
    for time_ns, T in zip(times_ns, T_world_camera, strict=True):
        w, x, y, z = quaternion_wxyz(T[:3, :3])
        numbers = (*T[:3, 3], x, y, z, w)
        rows.append(" ".join([tum_time(time_ns), *(repr(float(n)) for n in numbers)]))
    write_atomic(path, "".join(f"{row}\n" for row in rows).encode())


def tum_time(time_ns: int) -> str:
    """Seconds, to the nanosecond."""
    return f"{time_ns // NS_PER_S}.{time_ns % NS_PER_S:09d}"
