"""How the rows of a pair differ: by how the eyes are turned, and by how they stand to each other.

Between two views of small relative rotation the row difference v of a point at x, y (in focal
lengths from the centre) with the column difference u is

    v = a + b x + c y + k x y   +   t_y u + t_z (x v - y u).

The first part is rectification: shift, roll, scale, keystone; it does not depend on depth. The
second is the direction from one eye to the other, (1, t_y, t_z) along the row, down and forward: 0
of a rectified pair that was taken at one moment. A right picture taken later, while the rig drives
on, has t_z of the distance driven in units of the baseline.

Source: Longuet-Higgins 1981, the coplanarity of both rays and the baseline, linear in the rotation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pseudolidar.calibration.check_matches import PairMatches
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig

# Columns of the rectification, and all of them.
RECTIFICATION, ALL_COLUMNS = 4, 6
# Sets of matches that models are made of to find the one that fits best; exact seed.
HYPOTHESES, SEED = 300, 0
# An error beyond this counts no more, px.
COUNTED_PX = 1.0
# Noise of a match: no less than LK's own, and matches beyond the gate say nothing about it.
LEAST_NOISE_PX, NOISE_GATE_PX = 0.1, 3.0
REWEIGHTINGS = 12
# Matches lie in clumps that err alike.
CLUMP = 3.0
# An inlier is within so many sigmas, and never asked to be better than this.
INLIER_SIGMAS, INLIER_PX = 3.0, 1.0
# Parts of the picture: each that holds a match counts once, so that one rich corner is not all.
CELLS = (12, 8)


@dataclass(frozen=True, eq=False)
class RowFit:
    """The model fitted to a pair's matches.

    Args:
        matches: all of them.
        columns: (N, k) of the model, focal units.
        coefficients: (k,) px, and of the direction without unit.
        covariance: (k, k) of them.
        inliers: (N,) matches that agree.
        sigma_px: noise of the inliers.
        cost: mean squared error, px^2, none counted beyond `COUNTED_PX`: to compare models.
        focal_px: focal length that made x and y.
    """

    matches: PairMatches
    columns: Float64
    coefficients: Float64
    covariance: Float64
    inliers: Bool
    sigma_px: float
    cost: float
    focal_px: float

    @property
    def inlier_share(self) -> float:
        """Share of the matches that agree."""
        return float(np.mean(self.inliers))

    @property
    def offset_px(self) -> float:
        """Shift of the rows at the centre; positive where the right picture lies lower."""
        return float(self.coefficients[0])

    @property
    def roll_deg(self) -> float:
        """Roll of the right eye against the left; positive turns its right side down."""
        return float(np.degrees(self.coefficients[1] / self.focal_px))

    @property
    def roll_sigma_deg(self) -> float:
        """One standard deviation of it."""
        return float(np.degrees(np.sqrt(self.covariance[1, 1]) / self.focal_px))

    @property
    def scale(self) -> float:
        """By how much the right picture is larger, as a share."""
        return float(self.coefficients[2] / self.focal_px)

    @property
    def direction(self) -> tuple[float, float]:
        """(t_y, t_z): down and forward from eye to eye, in units of the baseline; (0, 0) untold."""
        if len(self.coefficients) < ALL_COLUMNS:
            return 0.0, 0.0
        return float(self.coefficients[4]), float(self.coefficients[5])

    @property
    def forward_sigma(self) -> float:
        """One standard deviation of t_z; infinite where it is not fitted."""
        if len(self.coefficients) < ALL_COLUMNS:
            return float("inf")
        return float(np.sqrt(self.covariance[5, 5]))

    @cached_property
    def cells(self) -> Float64:
        """(M, k) columns in the middle of the inliers of each occupied cell."""
        width, height = self.matches.size_px
        at = self.matches.left_px[self.inliers]
        column = np.clip(at[:, 0] * CELLS[0] / width, 0, CELLS[0] - 1).astype(int)
        row = np.clip(at[:, 1] * CELLS[1] / height, 0, CELLS[1] - 1).astype(int)
        _, cell = np.unique(row * CELLS[0] + column, return_inverse=True)
        counts = np.bincount(cell)
        values = self.columns[self.inliers]
        sums = [np.bincount(cell, weights=values[:, k]) for k in range(values.shape[1])]
        return np.stack(sums, axis=1) / counts[:, None]

    @property
    def typical_px(self) -> float:
        """Median over the occupied cells of how far the rows are off."""
        return float(np.median(np.abs(self.cells @ self.coefficients)))

    @property
    def typical_sigma_px(self) -> float:
        """One standard deviation of it."""
        variances = np.einsum("mi,ij,mj->m", self.cells, self.covariance, self.cells)
        return float(np.sqrt(np.median(variances)))


def fit_rows(matches: PairMatches, rig: StereoRig, *, direction: bool) -> RowFit | None:
    """Fit the model robustly; None with fewer matches than say anything.

    Args:
        matches: of the pair.
        rig: what it is said to be taken with; focal length and centre make x and y.
        direction: fit the direction from eye to eye, too.
    """
    size = ALL_COLUMNS if direction else RECTIFICATION
    if len(matches) < 2 * size:
        return None
    v = matches.row_difference_px
    columns = _columns(matches, rig)[:, :size]
    coefficients = _agreed(columns, v)
    sigma_px, weights = LEAST_NOISE_PX, np.ones_like(v)
    for _ in range(REWEIGHTINGS):
        residuals = v - columns @ coefficients
        sigma_px = _noise_px(residuals)
        weights = 1.0 / (1.0 + (residuals / sigma_px) ** 2)
        normal = columns.T @ (weights[:, None] * columns)
        coefficients = np.linalg.pinv(normal) @ (columns.T @ (weights * v))
    residuals = v - columns @ coefficients
    normal = columns.T @ (weights[:, None] * columns)
    return RowFit(
        matches,
        columns,
        coefficients,
        np.asarray(np.linalg.pinv(normal) * sigma_px**2 * CLUMP, np.float64),
        np.abs(residuals) < max(INLIER_SIGMAS * sigma_px, INLIER_PX),
        sigma_px,
        float(_cost(residuals)),
        rig.left.focal_px,
    )


def _columns(matches: PairMatches, rig: StereoRig) -> Float64:
    K = rig.left.K
    x = (matches.left_px[:, 0] - K[0, 2]) / K[0, 0]
    y = (matches.left_px[:, 1] - K[1, 2]) / K[1, 1]
    u = -matches.disparity_px - rig.doffs_px
    v = matches.row_difference_px
    return np.stack([np.ones_like(x), x, y, x * y, u, x * v - y * u], axis=1)


def _agreed(columns: Float64, v: Float64) -> Float64:
    """Of models through a few matches each, the one that costs least."""
    n, size = columns.shape
    rng = np.random.default_rng(SEED)
    chosen = rng.integers(0, n, (HYPOTHESES, size))
    # A match drawn twice leaves less than `size` equations: no inverse, but a least-norm one.
    models = (np.linalg.pinv(columns[chosen]) @ v[chosen][..., None])[..., 0]
    return np.asarray(models[np.argmin(_cost(v[None] - models @ columns.T))])


def _cost(residuals: Float64) -> Float64:
    return np.asarray(np.mean(np.minimum(residuals**2, COUNTED_PX**2), axis=-1))


def _noise_px(residuals: Float64) -> float:
    near = np.abs(residuals)[np.abs(residuals) < NOISE_GATE_PX]
    return max(LEAST_NOISE_PX, robust_sigma(near)) if len(near) else NOISE_GATE_PX
