"""`K.txt` of FoundationStereo: nine intrinsics row by row, then the baseline in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationUnits,
    CalibrationValue,
    StructureError,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import at_place
from pseudolidar.formats.rigs.rig_parts import LARGEST_BASELINE_M, LEFT, RIGHT
from pseudolidar.formats.rigs.rig_reading import PER_METRE, RigReading, RigUnit
from pseudolidar.formats.text import read_lines
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

NUMBERS = 10


def read_k_numbers(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[Float64, float | None]:
    """(3, 3) K and what stands behind it: the baseline, or None.

    Raises:
        CalibrationMissing: no such file.
        CalibrationSyntax: neither 9 nor 10 numbers, or no number; by line and column.
        CalibrationValue: no camera matrix.
    """
    lines = read_lines(path, error=CalibrationSyntax, missing=CalibrationMissing, limits=limits)
    numbers: list[float] = []
    for line in lines:
        numbers += line.numbers(line.words())
        if len(numbers) > NUMBERS:
            raise line.refusal(f"more than {NUMBERS} numbers", want="K, and the baseline in metres")
    if len(numbers) not in (NUMBERS - 1, NUMBERS):
        raise CalibrationSyntax(
            f"{len(numbers)} numbers",
            want="9 of K, row by row, and the baseline",
            path=path,
            where=f"line {len(lines)}",
        )
    K = np.array(numbers[:9]).reshape(3, 3)
    if not np.array_equal(K[2], (0.0, 0.0, 1.0)) or K[1, 0] != 0:
        raise CalibrationValue(
            f"a K with rows {K[1].tolist()} and {K[2].tolist()}",
            want="[0, fy, cy] and [0, 0, 1]",
            path=path,
            where="K",
        )
    return K, numbers[9] if len(numbers) == NUMBERS else None


def read_k_txt(
    path: Path,
    *,
    size_px: tuple[int, int],
    unit: RigUnit | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> RigReading:
    """Read a rectified rig whose cameras are equal.

    Args:
        path: the file.
        size_px: (width, height) of the pictures, which the file does not say.
        unit: of the baseline, where metres are not meant.
        limits: cap on its size.

    Raises:
        CalibrationMissing, CalibrationSyntax, CalibrationValue: as `read_k_numbers`; no baseline.
        CalibrationUnits: a baseline beyond 10 m, and `unit` is not given.
    """
    K, baseline = read_k_numbers(path, limits=limits)
    if baseline is None or not baseline > 0:
        raise CalibrationValue(
            "no baseline" if baseline is None else f"baseline {baseline:g}",
            want="a positive distance in metres behind K",
            path=path,
            where="baseline",
        )
    if unit is None and baseline > LARGEST_BASELINE_M:
        raise CalibrationUnits(
            f"a baseline of {baseline:g}, where metres are meant",
            want=f"at most {LARGEST_BASELINE_M:g} m",
            fix=f"If it is {baseline:g} mm, pass --rig-unit mm, or write {baseline / 1000:g}.",
            path=path,
            where="baseline",
        )
    t_m = np.array([-baseline / PER_METRE[unit or "m"], 0.0, 0.0])
    try:
        left, right = (Camera(K.copy(), *size_px, frame=frame) for frame in (LEFT, RIGHT))
        pose = Pose.from_rotation(RIGHT, LEFT, np.eye(3), t_m)
        rig = StereoRig(left, right, pose, origin=path.name)
    except CalibrationValue as error:
        raise at_place(error, path=path, where="K") from None
    note = f"{path.name}: both cameras have this K, so doffs is 0"
    return RigReading(path, "K.txt", rig, rig, (note,))


def write_k_txt(path: Path, rig: StereoRig) -> None:
    """Write K and the baseline of a rectified rig whose cameras are equal, with all digits.

    Raises:
        StructureError: cameras that differ, which the format cannot say.
        OutputError: the file cannot be written.
    """
    t_m = rig.T_right_left.translation_m
    if not rig.is_rectified or not np.array_equal(rig.left.K, rig.right.K) or t_m[1:].any():
        raise StructureError(
            "a rig of two different cameras",
            want="equal K and a baseline along the rows",
            fix="Write rig.json instead.",
            where="write_k_txt",
        )
    K = " ".join(repr(float(x)) for x in rig.left.K.ravel())
    write_atomic(path, f"{K}\n{-float(t_m[0])!r}\n".encode())
