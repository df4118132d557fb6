"""An oriented rectangle, seen from above, fitted to the near side of an object.

A rectangle is compared with what was measured where it was measured: along each line of sight, in
sigmas, so that points that are exact across and vague along their rays pull the way they can.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.class_sizes import ClassSize
from pseudolidar.obstacles.contour import Contour
from pseudolidar.structures.arrays import Float64

X, Z, HEADING, LENGTH, WIDTH = range(5)
STARTS, ROUNDS = 12, 12
STEPS = np.array([0.01, 0.01, 0.01, 0.01, 0.01])  # of the numeric derivatives: m and rad
SMALLEST_M = 0.1
# Residuals are bent from so many sigmas on; a direction that misses the rectangle is off by this.
BENT, MISSED = 1.5, 3.0
DAMPING = 1e-3


@dataclass(frozen=True)
class Edges:
    """Where the left and right edges of an object are in the picture.

    Args:
        left: bearing x / z of the left one; None where it is hidden or cut.
        right: of the right one.
        sigma: one standard deviation of both.
    """

    left: float | None
    right: float | None
    sigma: float


@dataclass(frozen=True, eq=False)
class Footprint:
    """A rectangle from above.

    Args:
        values: (5,) x and z of its centre (m), heading (rad, 0 along z, towards x positive),
            length along the heading, width (m).
        covariance: (5, 5) of these.
        misfit: root mean square of the residuals, in sigmas.
    """

    values: Float64
    covariance: Float64
    misfit: float

    @property
    def corners(self) -> Float64:
        """(4, 2) x, z."""
        return np.asarray(_corners(self.values[None])[0])

    @property
    def nearest_m(self) -> float:
        """Z of the nearest corner."""
        return float(self.corners[:, 1].min())

    @property
    def sigma_nearest_m(self) -> float:
        """One standard deviation of that."""
        gradient = np.zeros(5)
        for i, step in enumerate(STEPS):
            moved = self.values.copy()
            moved[i] += step
            gradient[i] = (_corners(moved[None])[0, :, 1].min() - self.nearest_m) / step
        return float(np.sqrt(max(0.0, float(gradient @ self.covariance @ gradient))))


def fitted(contour: Contour, edges: Edges, size: ClassSize, near_m: float) -> Footprint:
    """The rectangle that fits best, of those that a class may have.

    Source: Levenberg-Marquardt with a pseudo-Huber loss from several headings at once.

    Args:
        contour: near side.
        edges: of the object in the picture.
        size: usual length and width, and how they vary.
        near_m: about where its near side is.
    """
    values = _starts(contour, size, near_m)
    damping = np.full(len(values), DAMPING)
    loss, residuals = _loss(values, contour, edges, size)
    for _ in range(ROUNDS):
        jacobian = _jacobian(values, residuals, contour, edges, size)
        weights = 1.0 / np.sqrt(1.0 + (residuals / BENT) ** 2)
        weighed = jacobian * weights[:, :, None]
        hessian = np.einsum("sri,srj->sij", weighed, jacobian)
        slope = np.einsum("sri,sr->si", weighed, residuals)
        scaled = hessian + np.eye(5) * (damping[:, None] * _diagonal(hessian))[:, :, None]
        step = -np.linalg.solve(scaled, slope[:, :, None])[:, :, 0]
        tried = values + np.clip(step, -2.0, 2.0)
        tried[:, LENGTH:] = np.maximum(tried[:, LENGTH:], SMALLEST_M)
        new_loss, new_residuals = _loss(tried, contour, edges, size)
        better = new_loss < loss
        values = np.where(better[:, None], tried, values)
        residuals = np.where(better[:, None], new_residuals, residuals)
        loss = np.where(better, new_loss, loss)
        damping = np.where(better, damping * 0.3, damping * 10.0)
    best = int(np.argmin(loss))
    return _footprint(values[best], residuals[best], contour, edges, size)


def _footprint(
    values: Float64, residuals: Float64, contour: Contour, edges: Edges, size: ClassSize
) -> Footprint:
    one, left = values[None], residuals[None]
    jacobian = _jacobian(one, left, contour, edges, size)[0]
    weights = 1.0 / np.sqrt(1.0 + (residuals / BENT) ** 2)
    information = (jacobian * weights[:, None]).T @ jacobian
    seen = residuals[: len(contour)] * np.sqrt(len(contour) / contour.independent)
    misfit = float(np.sqrt(np.mean(seen * seen)))
    # What is no rectangle is not known as well as one: the Birge ratio.
    covariance = np.linalg.inv(information + 1e-9 * np.eye(5)) * max(1.0, misfit) ** 2
    return Footprint(values, covariance, misfit)


def _starts(contour: Contour, size: ClassSize, near_m: float) -> Float64:
    """(S, 5) rectangles of the usual size with all headings, their near side where it was seen."""
    heading = np.arange(STARTS) * np.pi / STARTS
    length, width = size.length_m[0], size.width_m[0]
    bearing = float(np.median(contour.bearing))
    back = 0.5 * (np.abs(np.cos(heading)) * length + np.abs(np.sin(heading)) * width)
    z = near_m + back
    return np.column_stack([bearing * z, z, heading, np.full(STARTS, length), [width] * STARTS])


def _loss(
    values: Float64, contour: Contour, edges: Edges, size: ClassSize
) -> tuple[Float64, Float64]:
    residuals = _residuals(values, contour, edges, size)
    bent = 2 * BENT**2 * (np.sqrt(1.0 + (residuals / BENT) ** 2) - 1.0)
    return bent.sum(axis=1), residuals


def _residuals(values: Float64, contour: Contour, edges: Edges, size: ClassSize) -> Float64:
    """(S, B + 4) in sigmas: depths by direction, left and right edge, length and width."""
    depth, missed = _depths(values, contour.bearing)
    along = (contour.depth_m - depth) / contour.sigma_m
    along = np.where(missed > 0, np.hypot(along, MISSED), along) / np.sqrt(
        len(contour) / contour.independent
    )
    corners = _corners(values)
    bearings = corners[:, :, 0] / np.maximum(corners[:, :, 1], SMALLEST_M)
    none = np.zeros(len(values))
    left = none if edges.left is None else (bearings.min(axis=1) - edges.left) / edges.sigma
    right = none if edges.right is None else (bearings.max(axis=1) - edges.right) / edges.sigma
    length = (values[:, LENGTH] - size.length_m[0]) / size.length_m[1]
    width = (values[:, WIDTH] - size.width_m[0]) / size.width_m[1]
    return np.column_stack([along, left, right, length, width])


def _jacobian(
    values: Float64, residuals: Float64, contour: Contour, edges: Edges, size: ClassSize
) -> Float64:
    """(S, R, 5) by forward differences."""
    moved = (values[:, None, :] + np.diag(STEPS)).reshape(-1, 5)
    changed = _residuals(moved, contour, edges, size).reshape(len(values), 5, -1)
    return np.asarray((changed - residuals[:, None, :]).transpose(0, 2, 1) / STEPS)


def _depths(values: Float64, bearing: Float64) -> tuple[Float64, Float64]:
    """(S, B) Z at which a line of sight meets the rectangle, and by how much it misses it."""
    s, c = np.sin(values[:, HEADING]), np.cos(values[:, HEADING])
    x, z = values[:, X], values[:, Z]
    near, far = np.full((len(values), len(bearing)), -np.inf), np.full((1, 1), np.inf)
    for ex, ez, half in ((s, c, 0.5 * values[:, LENGTH]), (c, -s, 0.5 * values[:, WIDTH])):
        rate = ex[:, None] * bearing + ez[:, None]
        rate = np.where(np.abs(rate) < 1e-6, 1e-6, rate)
        middle, reach = (ex * x + ez * z)[:, None] / rate, half[:, None] / np.abs(rate)
        near, far = np.maximum(near, middle - reach), np.minimum(far, middle + reach)
    return near, near - far


def _corners(values: Float64) -> Float64:
    """(S, 4, 2) x, z."""
    s, c = np.sin(values[:, HEADING]), np.cos(values[:, HEADING])
    a, b = 0.5 * values[:, LENGTH], 0.5 * values[:, WIDTH]
    along = np.stack([a * s, a * c], axis=1)
    across = np.stack([b * c, -b * s], axis=1)
    centre = values[:, : Z + 1]
    return np.stack(
        [centre + i * along + j * across for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))], axis=1
    )


def _diagonal(hessian: Float64) -> Float64:
    return np.asarray(np.einsum("sii->si", hessian))
