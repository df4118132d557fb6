"""What calibration files of other programs say about a pair, and the units that they leave open."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationUnits,
    CalibrationValue,
    NotRectified,
    StructureError,
)
from pseudolidar.formats.rigs.rig_parts import LARGEST_BASELINE_M, LEFT, NOWHERE_M, RIGHT
from pseudolidar.geometry.rectification import Rectification
from pseudolidar.geometry.unrectified import side_word, why_unrectified
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.pose import Pose, rotation_fault

RigUnit = Literal["m", "cm", "mm"]
# What pictures are taken for, where a calibration knows raw and rectified cameras.
Pictures = Literal["auto", "raw", "rectified"]
PER_METRE: dict[RigUnit, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0}


@dataclass(frozen=True, eq=False)
class RigReading:
    """Two cameras as files describe them.

    Args:
        path: the file or folder.
        form: what it was recognised as.
        rectified: rig of the rectified pictures, where it is known.
        raw: rig of the pictures as the cameras take them, where it is known.
        notes: what was assumed or left aside.
        min_depth_m: nearest depth that the data set claims to have.
        turns: (3, 3) rotations of the left and the right raw camera's directions into the
            rectified ones', where the file has them.
        projections: (3, 4) projection matrices as the file has them, by their names.
        rectified_note: what it means that both are known and pictures are taken for rectified.
    """

    path: Path
    form: str
    rectified: StereoRig | None = None
    raw: StereoRig | None = None
    notes: tuple[str, ...] = ()
    min_depth_m: float | None = None
    turns: tuple[Float64, Float64] | None = None
    projections: Mapping[str, Float64] = field(default_factory=dict)
    rectified_note: str = ""

    def taken_for(self, pictures: Pictures) -> RigReading:
        """The same without the rig that is not meant: rectified pictures count first.

        Raises:
            CalibrationField: pictures are said to be raw, and only rectified cameras are known.
        """
        if pictures == "raw":
            if self.raw is None:
                raise CalibrationField(
                    f"the cameras of rectified pictures alone ({self.form})",
                    want="K, distortion, R and T of the cameras as they are",
                    fix="Leave --rectify.pictures out, if the pictures are rectified.",
                    path=self.path,
                )
            return replace(self, rectified=self.raw if self.raw.is_rectified else None)
        if pictures == "rectified":
            _ = self.of_rectified
        told = (self.rectified_note,) if self.rectified_note else ()
        return replace(self, notes=(*self.notes, *told))

    @property
    def of_pictures(self) -> StereoRig:
        """The rig of rectified pictures where that is known, else of raw ones."""
        rig = self.rectified or self.raw
        assert rig is not None  # no reader returns a reading without either
        return rig

    @property
    def of_rectified(self) -> StereoRig:
        """The rig that rectified pictures need.

        Raises:
            NotRectified: only the unrectified cameras are known.
        """
        if self.rectified is None:
            why = "" if self.raw is None else "; ".join(why_unrectified(self.raw))
            raise NotRectified(
                f"a rig of unrectified cameras ({self.form})" + (f": {why}" if why else ""),
                want="the rig of rectified pictures: P1 and P2, projection_matrix, or equal "
                "focal lengths and rows without distortion",
                fix="Leave --rectify.pictures out to have them rectified as they load.",
                path=self.path,
            )
        return self.rectified


def unchanged(rig: StereoRig) -> Rectification:
    """The rectification of a rig that is rectified.

    Raises:
        NotRectified: it is not.
    """
    checked = RigReading(Path(), "rig", rig if rig.is_rectified else None, rig).of_rectified
    return Rectification(checked, checked, np.eye(3), np.eye(3))


def in_metres(t: Float64, unit: RigUnit | None, *, path: Path, where: str) -> Float64:
    """A translation in metres; in which unit the file has it is asked for, never guessed.

    Raises:
        CalibrationUnits: cameras further apart than any rig has them, and no unit given.
    """
    distance = math.hypot(*t)  # which does not overflow
    if unit is None and distance > LARGEST_BASELINE_M:
        raise CalibrationUnits(
            f"cameras {distance:g} apart, in a unit that the file does not say",
            want=f"at most {LARGEST_BASELINE_M:g} m",
            fix=f"Is it {distance:g} mm, {distance / 1000:.4g} m? Then pass --rig-unit mm "
            f"(or cm, m).",
            path=path,
            where=where,
        )
    return t / PER_METRE[unit or "m"]


def checked_order(T_right_left: Pose, *, path: Path, where: str) -> Pose:
    """The pose, if the right camera stands right of the left one.

    Raises:
        CalibrationValue: the eyes are exchanged or at one place, or one camera is above or behind
            the other.
    """
    x, y, z = place = T_right_left.inverse().translation_m
    if not np.abs(place).max() > NOWHERE_M:
        raise CalibrationValue(
            "baseline 0: both cameras at one place",
            want="two cameras apart",
            path=path,
            where=where,
        )
    if abs(y) > abs(x) or (x < 0 and abs(z) > abs(x)):
        axis = 1 if abs(y) > abs(z) else 2
        off = float(place[axis])
        raise CalibrationValue(
            f"the second camera is {abs(off):g} {side_word(axis, off)} the first",
            want="cameras side by side",
            path=path,
            where=where,
        )
    if x < 0:
        raise CalibrationValue(
            f"baseline {x:g}: the camera called left (first) stands right of the other",
            want="a positive baseline: the second camera right of the first",
            fix="The eyes are exchanged: name the cameras, and the pictures, the other way round.",
            path=path,
            where=where,
        )
    return T_right_left


def of_one_rectification(rig: StereoRig, matrices: str, *, path: Path, where: str) -> StereoRig:
    """The rig, if rows of its pictures correspond, as those of rectified ones do.

    Args:
        rig: made of what a file says of its rectified pictures.
        matrices: what it is made of, in words.
        path: the file.
        where: the place in it.

    Raises:
        CalibrationValue: its two cameras contradict each other.
    """
    if rig.is_rectified:
        return rig
    raise CalibrationValue(
        f"{matrices} are not of one rectification: {'; '.join(why_unrectified(rig))}",
        want="equal focal lengths, rows and sizes",
        fix="Take both from one run of the rectification, or give the cameras as they are.",
        path=path,
        where=where,
    )


def pose_right_left(R: Float64, t: Float64, *, path: Path, where: str) -> Pose:
    """`T_right_left`, if R is a rotation.

    Raises:
        CalibrationValue: it is none, to 1e-3.
    """
    try:
        return Pose.from_rotation(RIGHT, LEFT, R, t)
    except StructureError:
        raise CalibrationValue(
            f"R is no rotation: {rotation_fault(R)}",
            want="orthonormal to 1e-3, determinant 1",
            path=path,
            where=where,
        ) from None
