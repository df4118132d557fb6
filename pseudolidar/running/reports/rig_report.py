"""What a calibration says of a pair, in figures that a user can check against what they know."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pseudolidar.errors import ALL_DONE, CalibrationValue
from pseudolidar.formats.rigs.rig_json import rig_notes
from pseudolidar.formats.rigs.rig_quality import quality_fields
from pseudolidar.formats.rigs.rig_reading import RigReading
from pseudolidar.formats.rigs.rig_writers import WrittenRig
from pseudolidar.geometry.decomposition import Decomposition, decompose
from pseudolidar.geometry.odd_rig import field_deg, oddities
from pseudolidar.geometry.rectification import rectification
from pseudolidar.geometry.unrectified import rotation_deg, why_unrectified
from pseudolidar.running.table import table_text
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import Camera, StereoRig

# Depths at which the error of a disparity is told, m.
DEPTHS_M = (2.0, 5.0, 10.0, 20.0, 50.0)


@dataclass(frozen=True, eq=False)
class RigReport:
    """A calibration, and what was written of it.

    Args:
        reading: what was read.
        known_size: whether the size of the pictures is known.
        written: files in another form, if they were asked for.
        notes: what was done to find the size.
    """

    reading: RigReading
    known_size: bool = True
    written: WrittenRig | None = None
    notes: tuple[str, ...] = ()

    exit_code: int = field(default=ALL_DONE, init=False)

    @property
    def rig(self) -> StereoRig:
        """The rig of rectified pictures where that is known, else of those as taken."""
        return self.reading.of_pictures

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd about it."""
        odd = oddities(self.rig) if self.known_size else ()
        told = (note.removeprefix("warning: ") for note in self._all_notes if _warns(note))
        return tuple(dict.fromkeys((*odd, *told)))

    @property
    def _all_notes(self) -> tuple[str, ...]:
        written = self.written.notes if self.written else ()
        return (*self.notes, *self.reading.notes, *rig_notes(self.rig), *written)

    def as_dict(self) -> dict[str, Any]:
        """The object of `--json`."""
        rig, depth = self.rig, depth_figures(self.reading)
        return {
            "path": str(self.reading.path),
            "form": self.reading.form,
            "rectified": rig.is_rectified,
            "why_unrectified": list(why_unrectified(rig)),
            "left": camera_figures(rig.left, known_size=self.known_size),
            "right": camera_figures(rig.right, known_size=self.known_size),
            "baseline_m": float(np.linalg.norm(rig.T_right_left.translation_m)),
            "right_camera_at_m": rig.T_right_left.inverse().translation_m,
            "rotation_deg": rotation_deg(rig.T_right_left.matrix[:3, :3]),
            **depth,
            "velodyne": rig.T_left_velodyne is not None,
            "imu": rig.T_velodyne_imu is not None,
            "corrected": rig.correction is not None,
            "rows_corrected": rig.rows is not None,
            "quality": None if rig.quality is None else quality_fields(rig.quality),
            "projections": {
                name: _parts_figures(P, parts)
                for name, (P, parts) in decomposed(self.reading).items()
            },
            "warnings": list(self.warnings),
            "notes": [note for note in self._all_notes if not _warns(note)],
            "written": None
            if self.written is None
            else {"form": self.written.form, "files": [str(file) for file in self.written.files]},
        }

    def text(self) -> str:
        """Tables of the cameras, of depths and of projections, then what is odd."""
        rig = self.rig
        kind = "a rectified pair" if rig.is_rectified else "a pair before rectification"
        parts = [f"{self.reading.path}: {kind} ({self.reading.form})"]
        parts.append(table_text(self._camera_rows(), header=("", "left", "right")))
        parts.append(table_text(self._pair_rows()))
        parts.append(_projections_text(self.reading))
        if self.warnings:
            parts.append("\n".join(f"warning: {text}" for text in self.warnings))
        notes = [note for note in self._all_notes if not _warns(note)]
        if notes:
            parts.append("\n".join(f"note: {text}" for text in dict.fromkeys(notes)))
        if self.written is not None:
            names = ", ".join(str(file) for file in self.written.files)
            parts.append(f"wrote {names} ({self.written.form})")
        return "\n\n".join(part for part in parts if part)

    def _camera_rows(self) -> list[tuple[str, str, str]]:
        left, right = (
            camera_figures(camera, known_size=self.known_size)
            for camera in (self.rig.left, self.rig.right)
        )
        return [(name, _camera_text(name, left), _camera_text(name, right)) for name in _CAMERA]

    def _pair_rows(self) -> list[tuple[str, str]]:
        figures = self.as_dict()
        unit = "m" if self.rig.metric else "of unknown scale, no metres"
        rows = [("baseline", f"{figures['baseline_m']:.5g} {unit}")]
        if not self.rig.is_rectified:
            place = ", ".join(f"{x:.5g}" for x in figures["right_camera_at_m"])
            rows.append(("right camera at", f"{place} m; turned {figures['rotation_deg']:.3g} deg"))
            rows.append(("not rectified", "; ".join(figures["why_unrectified"])))
        if figures["f_px"] is None:
            return rows
        of = "" if self.rig.is_rectified else " after rectification (alpha 0)"
        rows.append((f"f{of}", f"{figures['f_px']:.5g} px"))
        rows.append(("f B", f"{figures['fB_px_m']:.5g} px m"))
        if figures["depth_at_1_px_m"] is not None:
            rows.append(("depth at 1 px", f"{figures['depth_at_1_px_m']:.5g} m"))
        if figures["doffs_px"]:
            rows.append(
                ("doffs", f"{figures['doffs_px']:.5g} px: disparity of infinity is minus it")
            )
        told = ", ".join(
            f"{each['error_m']:.2g} m at {each['depth_m']:g} m" for each in figures["pixel_errors"]
        )
        rows.append(("one pixel is worth", told))
        return rows


def camera_figures(camera: Camera, *, known_size: bool = True) -> dict[str, Any]:
    """Figures of one camera; null where the size of its pictures is needed and not known."""
    K = camera.K
    across, down = map(_known_or_none, field_deg(camera)) if known_size else (None, None)
    return {
        "width_px": camera.width_px if known_size else None,
        "height_px": camera.height_px if known_size else None,
        "fx_px": float(K[0, 0]),
        "fy_px": float(K[1, 1]),
        "cx_px": float(K[0, 2]),
        "cy_px": float(K[1, 2]),
        "field_deg": [across, down],
        "model": camera.model,
        "distortion": camera.distortion.tolist(),
    }


# Of a side of the picture where the lens is bent so that its formula turns back.
BEYOND = "wider than the model holds"


def _known_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


_CAMERA = ("picture", "focal lengths", "centre", "field", "lens", "distortion")


def _camera_text(name: str, figures: Mapping[str, Any]) -> str:
    match name:
        case "picture":
            known = figures["width_px"] is not None
            return f"{figures['width_px']}x{figures['height_px']} px" if known else "size unknown"
        case "focal lengths":
            return f"{figures['fx_px']:.6g}, {figures['fy_px']:.6g} px"
        case "centre":
            return f"{figures['cx_px']:.6g}, {figures['cy_px']:.6g} px"
        case "field":
            across, down = figures["field_deg"]
            if figures["width_px"] is None:
                return ""
            sides = (BEYOND if x is None else f"{x:.1f}" for x in (across, down))
            return " x ".join(sides) + " deg"
        case "lens":
            bent = any(figures["distortion"]) or figures["model"] == "fisheye"
            return f"{figures['model']}, {len(figures['distortion'])} numbers" if bent else "none"
    return " ".join(f"{x:.4g}" for x in figures["distortion"]) if any(figures["distortion"]) else ""


def depth_figures(reading: RigReading) -> dict[str, Any]:
    """What disparities of the rectified pair mean; null where it cannot be rectified."""
    unknown = dict.fromkeys(("f_px", "fB_px_m", "depth_at_1_px_m", "doffs_px"))
    rig = reading.rectified
    if rig is None:
        assert reading.raw is not None
        try:
            rig = rectification(reading.raw).rig
        except CalibrationValue:
            return {**unknown, "pixel_errors": []}
    fB, doffs = rig.fB_px_m, rig.doffs_px
    return {
        "f_px": rig.left.focal_px,
        "fB_px_m": fB,
        "depth_at_1_px_m": fB / (1 + doffs) if 1 + doffs > 0 else None,
        "doffs_px": doffs,
        # Z = fB / d, so that one pixel of d is worth Z^2 / fB.
        "pixel_errors": [{"depth_m": z, "error_m": z * z / fB} for z in DEPTHS_M],
    }


# --- projections ---------------------------------------------------------------------------------


def projections(reading: RigReading) -> Mapping[str, Float64]:
    """Projection matrices as the file has them, else those of its rig."""
    if reading.projections:
        return reading.projections
    rig = reading.rectified
    return {} if rig is None else {"P_left": rig.P_left, "P_right": rig.P_right}


def decomposed(reading: RigReading) -> Mapping[str, tuple[Float64, Decomposition]]:
    """Projection matrices and what they are made of, by their names.

    Raises:
        CalibrationValue: one of them is no camera.
    """
    found: dict[str, tuple[Float64, Decomposition]] = {}
    for name, P in projections(reading).items():
        try:
            found[name] = P, decompose(P)
        except CalibrationValue as error:
            raise error.located(reading.path, name) from None
    return found


def _parts_figures(P: Float64, parts: Decomposition) -> dict[str, Any]:
    return {"P": P, "K": parts.K, "R": parts.R, "t": parts.t, "centre": parts.centre}


def _projections_text(reading: RigReading) -> str:
    rows = [(name, *_parts_text(parts)) for name, (_, parts) in decomposed(reading).items()]
    header = ("P = K [R | t]", "fx, fy, cx, cy", "skew", "R", "t", "camera at")
    return table_text(rows, header=header) if rows else ""


def _parts_text(parts: Decomposition) -> tuple[str, str, str, str, str]:
    K = parts.K
    intrinsics = ", ".join(f"{x:.6g}" for x in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    angle_deg = rotation_deg(parts.R)
    turned = "identity" if angle_deg < 1e-9 else f"{angle_deg:.4g} deg"
    return intrinsics, f"{K[0, 1]:.2g}", turned, _vector(parts.t), _vector(parts.centre)


def _vector(values: Float64) -> str:
    return ", ".join(f"{x + 0.0:.5g}" for x in values)


def _warns(note: str) -> bool:
    return note.startswith("warning: ")
