"""What a rig's calibration left to be put right, beyond cameras and baseline."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from pseudolidar.errors import CalibrationValue
from pseudolidar.structures.arrays import Float32, Float64, check_array


@dataclass(frozen=True, eq=False)
class SigmaScale:
    """Factor on a matcher's sigma by the disparity: linear between knots, constant beyond them.

    Args:
        disparities_px: (K,) float64 px, ascending.
        factors: (K,) float64 at these.
    """

    disparities_px: Float64 = field(default_factory=lambda: np.zeros(1))
    factors: Float64 = field(default_factory=lambda: np.ones(1))

    def __post_init__(self) -> None:
        check_array("SigmaScale", "disparities_px", self.disparities_px, (None,), np.float64)
        check_array("SigmaScale", "factors", self.factors, self.disparities_px.shape, np.float64)
        finite = np.isfinite(self.disparities_px).all() and np.isfinite(self.factors).all()
        if not (len(self.factors) and finite and (self.factors > 0).all()):
            raise CalibrationValue(
                f"sigma_scale {self.factors.tolist()}", want="above 0", where="correction"
            )
        if not (np.diff(self.disparities_px) > 0).all():
            raise CalibrationValue(
                f"sigma_scale at {self.disparities_px.tolist()} px",
                want="ascending disparities",
                where="correction",
            )

    @classmethod
    def constant(cls, factor: float) -> SigmaScale:
        """The same for all disparities."""
        return cls(np.zeros(1), np.array([float(factor)]))

    def at(self, d: Float64) -> Float64:
        """(N,) factors for measured disparities `d` (N,) px; NaN stays NaN."""
        return np.interp(d, self.disparities_px, self.factors)

    def scaled(self, ratio: float) -> SigmaScale:
        """For images whose disparities are `ratio` times as large."""
        return replace(self, disparities_px=self.disparities_px * ratio)

    def __str__(self) -> str:
        """The factors, with their disparities where they are several."""
        if len(self.factors) == 1:
            return f"{self.factors[0]:.2f}"
        pairs = zip(self.factors, self.disparities_px, strict=True)
        return ", ".join(f"{factor:.2f} at {d:.0f} px" for factor, d in pairs)


@dataclass(frozen=True, eq=False)
class DisparityCorrection:
    """Smooth systematic error of a rig's disparities: `d_true = d - c . phi(d, u, v)`.

    phi = (1, d/50, x, y, x^2, x y, y^2, x^3, x^2 y, x^4); x, y are pixel coordinates scaled to
    [-1, 1] by the image size.

    Args:
        coefficients: (10,) float64, px.
        residual_px: systematic error that is left after the correction, one standard deviation.
        origin: what it was fitted to, in words.
        sigma_scale: factor on the matcher's sigma that the pictures it was fitted to ask for.
        covariance: (10, 10) float64 px^2 of the coefficients, or None where it is not known.
        fitted_m: nearest and farthest depth Z that it was fitted to; None where it is not known.

    Source: measured on KITTI stereo 2015 against Velodyne; the bias belongs to the rig and not
        to the matcher.
    """

    coefficients: Float64
    residual_px: float
    origin: str = ""
    sigma_scale: SigmaScale = field(default_factory=SigmaScale)
    covariance: Float64 | None = None
    fitted_m: tuple[float, float] | None = None

    TERMS: ClassVar[int] = 10
    DISPARITY_UNIT_PX: ClassVar[float] = 50.0

    def __post_init__(self) -> None:
        check_array(
            "DisparityCorrection", "coefficients", self.coefficients, (self.TERMS,), np.float64
        )
        if not (np.isfinite(self.coefficients).all() and self.residual_px >= 0):
            raise CalibrationValue(
                "non-finite coefficients or negative residual", where="correction"
            )
        if self.fitted_m is not None and not 0 <= self.fitted_m[0] <= self.fitted_m[1]:
            raise CalibrationValue(
                f"fitted_m {list(self.fitted_m)}",
                want="nearest and farthest depth, m",
                where="correction",
            )
        if self.covariance is not None:
            shape = (self.TERMS, self.TERMS)
            check_array("DisparityCorrection", "covariance", self.covariance, shape, np.float64)

    @classmethod
    def features(cls, d: Float64, u: Float64, v: Float64, size_px: tuple[int, int]) -> Float64:
        """(N, 10) features of disparities `d` at pixels `u`, `v`, each (N,)."""
        x = 2.0 * u / (size_px[0] - 1) - 1.0
        y = 2.0 * v / (size_px[1] - 1) - 1.0
        xx = x * x
        smooth = (np.ones_like(x), d / cls.DISPARITY_UNIT_PX, x, y, xx, x * y, y * y, xx * x)
        columns = (*smooth, xx * y, xx * xx)
        return np.stack(columns, axis=-1)

    def offset_px(self, d: Float64, u: Float64, v: Float64, size_px: tuple[int, int]) -> Float64:
        """(N,) px to subtract from measured disparities."""
        features = self.features(d, u, v, size_px)
        offset = self.coefficients[0] * features[..., 0]
        for column in range(1, len(self.coefficients)):  # no BLAS: it rounds by its threads
            offset += self.coefficients[column] * features[..., column]
        return np.asarray(offset)

    @property
    def per_px(self) -> float:
        """What each px of disparity adds to the offset."""
        return float(self.coefficients[1]) / self.DISPARITY_UNIT_PX

    def field_px(self, width: int, height: int) -> Float32:
        """(H, W) of `offset_px` of no disparity at every pixel: quartic along a row."""
        x = np.linspace(-1.0, 1.0, width)
        y = np.linspace(-1.0, 1.0, height)[:, None].astype(np.float32)
        c = self.coefficients
        even = (((c[9] * x + c[7]) * x + c[4]) * x + c[2]) * x + c[0]
        linear = (c[8] * x + c[5]) * x + c[3]
        field = y * np.float32(c[6])
        field = field + linear.astype(np.float32)
        field *= y
        field += even.astype(np.float32)
        return np.asarray(field)

    def offset_sigma_px(
        self, d: Float64, u: Float64, v: Float64, size_px: tuple[int, int]
    ) -> Float64 | None:
        """(N,) px, one standard deviation of `offset_px`; None where it is not known."""
        if self.covariance is None:
            return None
        features = self.features(d, u, v, size_px)
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", features, self.covariance, features)))

    def scaled(self, ratio: float) -> DisparityCorrection:
        """The correction for images whose width, and with it disparity, is `ratio` times as large.

        The second coefficient is multiplied by the disparity, which already scales.
        """
        coefficients = self.coefficients * ratio
        coefficients[1] = self.coefficients[1]
        covariance = self.covariance
        if covariance is not None:
            factor = np.full(self.TERMS, ratio)
            factor[1] = 1.0
            covariance = covariance * np.outer(factor, factor)
        return replace(
            self,
            coefficients=coefficients,
            residual_px=self.residual_px * ratio,
            covariance=covariance,
            sigma_scale=self.sigma_scale.scaled(ratio),
        )


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

    def field_px(self, width: int, height: int) -> Float32:
        """(H, W) of `offset_px` at every pixel: cubic along a row, square along a column."""
        x = np.linspace(-1.0, 1.0, width)
        y = np.linspace(-1.0, 1.0, height)[:, None].astype(np.float32)
        c = self.coefficients
        even = ((c[8] * x + c[3]) * x + c[1]) * x + c[0]
        linear, square = (c[6] * x + c[4]) * x + c[2], c[7] * x + c[5]
        field = y * square.astype(np.float32)
        field += linear.astype(np.float32)
        field *= y
        field += even.astype(np.float32)
        return np.asarray(field)

    def scaled(self, ratio: float) -> RowCorrection:
        """The correction for images whose height is `ratio` times as large."""
        return replace(
            self, coefficients=self.coefficients * ratio, residual_px=self.residual_px * ratio
        )
