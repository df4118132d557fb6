"""How well a rig is calibrated, as far as its calibration tells."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.errors import CalibrationValue
from pseudolidar.structures.arrays import Float64, check_array
from pseudolidar.structures.disparity import typed_below

# Figures of a calibration that are in pixels.
PIXELS = ("rms_left_px", "rms_right_px", "rms_stereo_px", "holdout_row_error_px")

# The edge of a board and the hand that holds it are nearer than its corners, by this factor.
NEARER_THAN_CORNERS = 0.9


@dataclass(frozen=True, eq=False)
class CameraSigma:
    """Standard deviations of one camera's intrinsics.

    Args:
        intrinsics_px: (4,) float64 px, of fx, fy, cx, cy.
        distortion: (n,) float64, of its coefficients; empty where they are not known.

    Raises:
        CalibrationValue: one of them is negative or no number.
    """

    intrinsics_px: Float64
    distortion: Float64 = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        _check_sigmas("intrinsics_px", self.intrinsics_px, 4)
        _check_sigmas("distortion", self.distortion, None)

    def scaled(self, x_ratio: float, y_ratio: float) -> CameraSigma:
        """For images of other width and height; distortion is of normalised coordinates."""
        ratios = np.array([x_ratio, y_ratio, x_ratio, y_ratio])
        return replace(self, intrinsics_px=self.intrinsics_px * ratios)


@dataclass(frozen=True, eq=False)
class CalibrationQuality:
    """Residuals and standard deviations of a calibration; None for what is not known.

    Args:
        rms_left_px: reprojection error of the left camera calibrated alone.
        rms_right_px: of the right one.
        rms_stereo_px: of both with one pose between them.
        holdout_row_error_px: mean absolute row difference of rectified points, in views that
            were not used for the fit.
        views: pairs of pictures that were used.
        left: standard deviations of the left camera.
        right: of the right one.
        rotation_sigma_rad: (3,) of the rotation vector of `T_right_left`.
        translation_sigma_m: (3,) of its translation.
        baseline_sigma_m: of the distance of the optical centres.
        depth_sigma_m: (M, 2) float64: depths Z, ascending, and the standard deviation that the
            calibration (not the matcher) is expected to give them, m.
        nearest_m: depth of the nearest corner of a board that it was made with.

    Raises:
        CalibrationValue: a figure is negative or no number.
    """

    rms_left_px: float | None = None
    rms_right_px: float | None = None
    rms_stereo_px: float | None = None
    holdout_row_error_px: float | None = None
    views: int | None = None
    left: CameraSigma | None = None
    right: CameraSigma | None = None
    rotation_sigma_rad: Float64 | None = None
    translation_sigma_m: Float64 | None = None
    baseline_sigma_m: float | None = None
    depth_sigma_m: Float64 | None = None
    nearest_m: float | None = None

    def __post_init__(self) -> None:
        for name in (*PIXELS, "baseline_sigma_m", "views"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value >= 0):
                raise CalibrationValue(f"{name} {value:g}", want="0 or more", where="quality")
        if self.nearest_m is not None and not 0 < self.nearest_m < np.inf:
            raise CalibrationValue(f"nearest_m {self.nearest_m:g}", want="above 0", where="quality")
        for name in ("rotation_sigma_rad", "translation_sigma_m"):
            if getattr(self, name) is not None:
                _check_sigmas(name, getattr(self, name), 3)
        if self.depth_sigma_m is not None:
            check_array("CalibrationQuality", "depth_sigma_m", self.depth_sigma_m, (None, 2),
                        np.float64)  # fmt: skip
            _check_sigmas("depth_sigma_m", self.depth_sigma_m.ravel(), None)
            if not (np.diff(self.depth_sigma_m[:, 0]) > 0).all():
                raise CalibrationValue(
                    f"depth_sigma_m at {self.depth_sigma_m[:, 0].tolist()} m",
                    want="ascending depths",
                    where="quality",
                )

    @property
    def searched_from_m(self) -> float | None:
        """Depth from which on a rig is to be used that was calibrated so near."""
        return None if self.nearest_m is None else typed_below(self.nearest_m * NEARER_THAN_CORNERS)

    def scaled(self, x_ratio: float, y_ratio: float) -> CalibrationQuality:
        """For images of other width and height; reprojection errors by both, rows by the height."""
        ratios = dict.fromkeys(PIXELS, float(np.sqrt(x_ratio * y_ratio)))
        ratios["holdout_row_error_px"] = y_ratio
        pixels = {name: getattr(self, name) for name in ratios}
        changed = {
            name: value * ratios[name] for name, value in pixels.items() if value is not None
        }
        return replace(
            self,
            left=self.left and self.left.scaled(x_ratio, y_ratio),
            right=self.right and self.right.scaled(x_ratio, y_ratio),
            **changed,
        )

    def __str__(self) -> str:
        """In words, for a note: stereo rms 0.25 px, rows 0.14 px on held-out views, 29 views."""
        parts = [
            f"stereo rms {self.rms_stereo_px:.2f} px" if self.rms_stereo_px is not None else "",
            f"rows {self.holdout_row_error_px:.2f} px on held-out views"
            if self.holdout_row_error_px is not None
            else "",
            f"{self.views} views" if self.views is not None else "",
            f"baseline to {self.baseline_sigma_m * 1000:.2g} mm"
            if self.baseline_sigma_m is not None
            else "",
            f"board from {self.nearest_m:.2g} m on" if self.nearest_m is not None else "",
        ]
        return ", ".join(part for part in parts if part)


def _check_sigmas(name: str, values: Float64, count: int | None) -> None:
    check_array("CalibrationQuality", name, values, (count,), np.float64)
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise CalibrationValue(
            f"{name} {values.tolist()}", want="finite, 0 or more", where="quality"
        )
