"""Trajectories as EuRoC writes them: CSV of nanoseconds, position, quaternion w first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pseudolidar.errors import PoseFileError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import TextLine, Word, read_lines
from pseudolidar.geometry.quaternion import quaternion_wxyz, rotations_of
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import ROTATION_TOLERANCE

# Time, position and quaternion come first; velocity and biases of the IMU may follow.
POSE_COLUMNS = 8
HEADING = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
)
LARGEST_NS = 2**63
LONGEST = len(str(LARGEST_NS))


def read_euroc_trajectory(
    path: Path, *, limits: Limits = DEFAULT_LIMITS
) -> tuple[tuple[int, ...], Float64]:
    """Read a trajectory: `ns,x,y,z,qw,qx,qy,qz` by line; further columns are passed over.

    Returns:
        Times, ns, and (N, 4, 4) `T_world_body`, metres.

    Raises:
        PoseFileError: missing file, no number, too few, a quaternion that is none; by line.
    """
    times: list[int] = []
    numbers: list[list[float]] = []
    for line, cells in _rows(path, limits):
        times.append(_time_ns(line, cells[0]))
        numbers.append([line.number_of(cell) for cell in cells[1:POSE_COLUMNS]])
        length = math.hypot(*numbers[-1][3:])
        if not abs(length - 1) <= ROTATION_TOLERANCE:
            raise line.refusal(f"a quaternion of length {length:.4g}", want="1, to 1e-3")
    values = np.array(numbers, np.float64).reshape(-1, POSE_COLUMNS - 1)
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotations_of(values[:, 3:]), values[:, :3]
    return tuple(times), poses


def _rows(path: Path, limits: Limits) -> Iterator[tuple[TextLine, list[Word]]]:
    """Lines with their cells, without comments, and without a heading that has no #."""
    for line in read_lines(path, error=PoseFileError, limits=limits):
        text = line.text.lstrip()
        if not text or text.startswith("#") or (line.number == 1 and text[0].isalpha()):
            continue
        cells, column = [], 1
        for part in line.text.split(","):
            cells.append(Word(part.strip(" \t"), column + len(part) - len(part.lstrip(" \t"))))
            column += len(part) + 1
        if len(cells) < POSE_COLUMNS:
            raise line.refusal(f"{len(cells)} columns", want=f"{POSE_COLUMNS} or more, by commas")
        yield line, cells


def _time_ns(line: TextLine, cell: Word) -> int:
    whole = cell.text.isascii() and cell.text.isdecimal() and len(cell.text) <= LONGEST
    if not whole or int(cell.text) >= LARGEST_NS:
        raise line.refusal(
            f"{cell.text[:40]!r}", want="whole nanoseconds, as EuRoC has them", column=cell.column
        )
    return int(cell.text)


def write_euroc_trajectory(path: Path, times_ns: Sequence[int], T_world_body: Float64) -> None:
    """Write (N, 4, 4) poses as EuRoC's ground truth, times exact, numbers with all digits."""
    rows = [HEADING]
    for time_ns, T in zip(times_ns, T_world_body, strict=True):
        numbers = (*T[:3, 3], *quaternion_wxyz(T[:3, :3]))
        rows.append(",".join([str(int(time_ns)), *(repr(float(n)) for n in numbers)]))
    write_atomic(path, "".join(f"{row}\n" for row in rows).encode())
