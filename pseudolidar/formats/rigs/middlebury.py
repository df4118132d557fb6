"""`calib.txt` of Middlebury 2014 and 2021 and of ETH3D two-view; read_x beside write_x."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationUnits,
    CalibrationValue,
)
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import at_place
from pseudolidar.formats.rigs.rig_parts import LARGEST_BASELINE_M, LEFT, RIGHT
from pseudolidar.formats.rigs.rig_reading import (
    PER_METRE,
    RigReading,
    RigUnit,
    of_one_rectification,
)
from pseudolidar.formats.text import WORD, TextLine, Word, read_lines
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

_KEY = re.compile(r"[ \t]*([A-Za-z_]\w*)[ \t]*=[ \t]*")
_IN_BRACKETS = re.compile(r"[^ \t\[\];,]+")
MATRICES, NUMBERS = ("cam0", "cam1"), ("doffs", "baseline", "width", "height", "ndisp")
OTHERS = ("isint", "vmin", "vmax", "dyavg", "dymax")
# doffs and cx are written with three decimals each.
DOFFS_TOLERANCE_PX = 0.01
# Ranges are searched in steps of 32 px, to the nearest: half a step more has ndisp inside.
RANGE_MARGIN_PX = 16
# The smallest that is believed: rigs of a millimetre exist behind endoscopes only.
SMALLEST_BASELINE_M = 1e-3


@dataclass(frozen=True, eq=False)
class _Fields:
    """The values of a file with the line that each stands in."""

    path: Path
    values: Mapping[str, Float64]
    lines: Mapping[str, int]

    def number(self, key: str) -> float:
        return float(self.values[key][0])

    def require(self, *keys: str) -> None:
        for key in keys:
            if key not in self.values:
                raise CalibrationField(
                    f"no {key}; found {', '.join(self.lines) or 'no key at all'}",
                    want=key,
                    fix="Is this a calib.txt of Middlebury 2014, 2021 or ETH3D?",
                    path=self.path,
                    where=key,
                )

    def place(self, key: str) -> str:
        return f"{key}, line {self.lines[key]}"

    def refusal(self, key: str, got: str, want: str) -> CalibrationValue:
        return CalibrationValue(got, want=want, path=self.path, where=self.place(key))


def read_middlebury_calib(
    path: Path, *, unit: RigUnit | None = None, limits: Limits = DEFAULT_LIMITS
) -> RigReading:
    """Read a `calib.txt`; its lengths are millimetres unless `unit` says otherwise.

    `doffs` is cx1 - cx0: it is applied by the cameras' own principal points, and reported.

    Raises:
        CalibrationMissing: no such file.
        CalibrationField: a key missing, unknown in its form, or twice.
        CalibrationSyntax: no number, or another count; by line and column.
        CalibrationValue: `doffs` or `ndisp` contradict the rest, an impossible camera.
        CalibrationUnits: a baseline that cannot be millimetres, and `unit` is not given.
    """
    fields = _read(path, limits)
    fields.require("cam0", "cam1", "baseline", "width", "height")
    left, right = (_camera(fields, *named) for named in zip(MATRICES, (LEFT, RIGHT), strict=True))
    baseline_m = _baseline_m(fields, unit)
    notes = [_doffs_note(fields, float(right.K[0, 2] - left.K[0, 2]))]
    pose = Pose.from_rotation(RIGHT, LEFT, np.eye(3), np.array([-baseline_m, 0.0, 0.0]))
    rig = of_one_rectification(
        StereoRig(left, right, pose, origin=path.name),
        "cam0 and cam1",
        path=path,
        where=fields.place("cam1"),
    )
    nearest = _nearest_m(fields, rig, notes)
    return RigReading(path, "Middlebury calib.txt", rig, rig, tuple(notes), nearest)


def _camera(fields: _Fields, key: str, frame: str) -> Camera:
    K = fields.values[key].reshape(3, 3)
    if not np.array_equal(K[2], (0.0, 0.0, 1.0)) or K[1, 0] != 0:
        got = f"a K with rows {K[1].tolist()} and {K[2].tolist()}"
        raise fields.refusal(key, got, "[0, fy, cy] and [0, 0, 1]")
    try:
        return Camera(K, *_size(fields), frame=frame)
    except CalibrationValue as error:
        raise at_place(error, path=fields.path, where=fields.place(key)) from None


def _baseline_m(fields: _Fields, unit: RigUnit | None) -> float:
    value = fields.number("baseline")
    if not value > 0:
        raise fields.refusal("baseline", f"baseline {value:g}", "above 0")
    baseline_m = value / PER_METRE[unit or "mm"]
    if unit is None and not SMALLEST_BASELINE_M <= baseline_m <= LARGEST_BASELINE_M:
        raise CalibrationUnits(
            f"baseline {value:g}, which would be {baseline_m:g} m",
            want=f"millimetres, {1000 * SMALLEST_BASELINE_M:g} to {1000 * LARGEST_BASELINE_M:g}",
            fix=f"Is it {value:g} m, or cm? Then pass the file by --rig, with --rig-unit m or cm.",
            path=fields.path,
            where=fields.place("baseline"),
        )
    return baseline_m


def _doffs_note(fields: _Fields, cx_difference: float) -> str:
    name = fields.path.name
    if "doffs" not in fields.values:
        return f"{name}: no doffs; {cx_difference:.3f} px taken, cx of cam1 less that of cam0"
    doffs = fields.number("doffs")
    if abs(doffs - cx_difference) > DOFFS_TOLERANCE_PX:
        raise fields.refusal(
            "doffs",
            f"doffs {doffs:g} px, but cx of cam1 less that of cam0 is {cx_difference:g} px",
            f"the same, to {DOFFS_TOLERANCE_PX:g} px",
        )
    return f"{name}: doffs {doffs:g} px applied: Z = f B / (d + doffs)"


def _nearest_m(fields: _Fields, rig: StereoRig, notes: list[str]) -> float | None:
    """Depth of the largest disparity that the data set claims, `ndisp`."""
    if "ndisp" not in fields.values:
        notes.append(f"{fields.path.name}: no ndisp; the disparity range follows --min-depth")
        return None
    ndisp = fields.number("ndisp")
    if not (ndisp == int(ndisp) and 0 < ndisp <= rig.left.width_px and ndisp + rig.doffs_px > 0):
        raise fields.refusal(
            "ndisp", f"ndisp {ndisp:g}", f"a whole number from 1 to {rig.left.width_px}, the width"
        )
    return rig.fB_px_m / (ndisp + RANGE_MARGIN_PX + rig.doffs_px)


def _size(fields: _Fields) -> tuple[int, int]:
    sides = []
    for key in ("width", "height"):
        value = fields.number(key)
        if not (value == int(value) and value >= 1):
            raise fields.refusal(key, f"{key} {value:g}", "a whole number of pixels, 1 or more")
        sides.append(int(value))
    return sides[0], sides[1]


def _read(path: Path, limits: Limits) -> _Fields:
    values: dict[str, Float64] = {}
    lines: dict[str, int] = {}
    for line in read_lines(
        path, error=CalibrationSyntax, missing=CalibrationMissing, limits=limits
    ):
        if not line.text.strip(" \t"):
            continue
        match = _KEY.match(line.text)
        if match is None:
            raise line.refusal(
                f"a line that starts with {line.text[:20]!r}", want="KEY=value", column=1
            )
        key = match[1]
        if key in lines:
            raise CalibrationField(
                f"{key} twice, in lines {lines[key]} and {line.number}",
                want="each key once",
                path=path,
                where=f"line {line.number}",
            )
        lines[key] = line.number
        if key in (*MATRICES, *NUMBERS):
            values[key] = _numbers(line, match.end(), 9 if key in MATRICES else 1)
    return _Fields(path, values, lines)


def _numbers(line: TextLine, start: int, count: int) -> Float64:
    text = " " * start + line.text[start:]  # so that columns stay
    form = _IN_BRACKETS if count > 1 else WORD
    words = [Word(m[0], m.start() + 1) for m in form.finditer(text)]
    return np.array(line.numbers(words, count=count))


def is_middlebury_calib(text: str) -> bool:
    """Whether a file begins as a `calib.txt` of this kind."""
    lines = text.removeprefix("\xef\xbb\xbf").removeprefix("\ufeff").splitlines()
    return any(line.lstrip(" \t").startswith(MATRICES) and "=" in line for line in lines[:20])


def write_middlebury_calib(path: Path, rig: StereoRig, *, ndisp: int) -> None:
    """Write a rectified rig as `calib.txt`, with all digits.

    Args:
        path: the file.
        rig: rectified, its centres along the rows.
        ndisp: bound on the disparities of the data.

    Raises:
        OutputError: the file cannot be written.
    """
    width, height = rig.left.size_px
    lines = [f"cam{n}={_matrix_text(camera.K)}" for n, camera in enumerate((rig.left, rig.right))]
    # In decimal, so that no digit is lost: 0.193001 m is 193.001 mm.
    millimetres = float(Decimal(repr(rig.baseline_m)) * 1000)
    lines += [f"doffs={rig.doffs_px!r}", f"baseline={millimetres!r}"]
    lines += [f"width={width}", f"height={height}", f"ndisp={ndisp}"]
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def _matrix_text(K: Float64) -> str:
    return "[" + "; ".join(" ".join(repr(float(x)) for x in row) for row in K) + "]"
