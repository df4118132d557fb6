"""What a rig's calibration left to be put right, beyond cameras and baseline."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import CalibrationValue
from pseudolidar.structures.arrays import Float64, check_array


@dataclass(frozen=True, eq=False)
class RowCorrection:
    """How much lower the right picture shows what the left one shows in the same row.

    `v_right = v_left + c . phi(u_right, v_left)`, with phi = (1, x, y, x^2, x y, y^2, x^2 y, x y^2,
    x^3); x, y are pixel coordinates scaled to [-1, 1] by the image size.

    Args:
        coefficients: (9,) float64, px.
        residual_px: row difference that is left after the correction, 68 % of points.
        origin: what it was fitted to, in words.

    Source: measured on KITTI, where it is up to 1 px at the corners of the picture.
    """

    coefficients: Float64
    residual_px: float
    origin: str = ""

    def __post_init__(self) -> None:
        check_array("RowCorrection", "coefficients", self.coefficients, (9,), np.float64)
        if not (np.isfinite(self.coefficients).all() and self.residual_px >= 0):
            raise CalibrationValue("non-finite coefficients or negative residual", where="rows")

    @classmethod
    def features(cls, u: Float64, v: Float64, size_px: tuple[int, int]) -> Float64:
        """(..., 9) features of pixels `u`, `v` (...) of the right picture."""
        x = 2.0 * u / (size_px[0] - 1) - 1.0
        y = 2.0 * v / (size_px[1] - 1) - 1.0
        columns = (np.ones_like(x), x, y, x * x, x * y, y * y, x * x * y, x * y * y, x**3)
        return np.stack(columns, axis=-1)

    def offset_px(self, u: Float64, v: Float64, size_px: tuple[int, int]) -> Float64:
        """(...) px that the right picture shows row `v` lower at column `u`."""
        features = self.features(u, v, size_px)
        offset = self.coefficients[0] * features[..., 0]
        for column in range(1, len(self.coefficients)):  # no BLAS: it rounds by its threads
            offset += self.coefficients[column] * features[..., column]
        return np.asarray(offset)

    def scaled(self, ratio: float) -> RowCorrection:
        """The correction for images whose height is `ratio` times as large."""
        return replace(
            self, coefficients=self.coefficients * ratio, residual_px=self.residual_px * ratio
        )
