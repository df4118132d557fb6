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
STEP = 0.01  # of numeric derivatives: m and rad

# (3, B) bearing, depth and sigma; directions of a measurement; usual size; edges.
_Given = tuple[Float64, float, Float64, Float64]


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
        moved = self.values + STEP * np.eye(len(self.values))
        gradient = (_corners(moved)[:, :, 1].min(axis=1) - self.nearest_m) / STEP
        return float(np.sqrt(max(0.0, float(gradient @ self.covariance @ gradient))))


def fitted(contour: Contour, edges: Edges, size: ClassSize, near_m: float) -> Footprint:
    """The rectangle that fits best, of those that a class may have.

    Source: Levenberg-Marquardt with a pseudo-Huber loss from several headings.

    Args:
        contour: near side.
        edges: of the object in the picture.
        size: usual length and width, and how they vary.
        near_m: about where its near side is.
    """
    from pseudolidar.obstacles.footprint_kernels import best_rectangle

    given = _given(contour, edges, size)
    values = best_rectangle(_starts(contour, size, near_m), *given, ROUNDS)
    return _footprint(values, given, contour)


def _given(contour: Contour, edges: Edges, size: ClassSize) -> _Given:
    """What was seen and what is usual, as the kernels take it."""
    seen = np.stack([contour.bearing, contour.depth_m, contour.sigma_m])
    share = float(np.sqrt(len(contour) / contour.independent))
    hidden = (np.nan if edge is None else edge for edge in (edges.left, edges.right))
    return seen, share, np.array([*size.length_m, *size.width_m]), np.array([*hidden, edges.sigma])


def _footprint(values: Float64, given: _Given, contour: Contour) -> Footprint:
    from pseudolidar.obstacles.footprint_kernels import BENT, jacobian_of, residuals_of

    residuals = np.empty(len(contour) + 4)
    jacobian = np.empty((len(values), len(residuals)))
    residuals_of(values, *given, residuals)
    jacobian_of(values, residuals, *given, jacobian)
    weights = 1.0 / np.sqrt(1.0 + (residuals / BENT) ** 2)
    information = (jacobian * weights) @ jacobian.T
    seen = residuals[: len(contour)] * np.sqrt(len(contour) / contour.independent)
    misfit = float(np.sqrt(np.mean(seen * seen)))
    # What is no rectangle is not known as well as one: the Birge ratio.
    covariance = np.linalg.inv(information + 1e-9 * np.eye(5)) * max(1.0, misfit) ** 2
    return Footprint(values, np.asarray(covariance, np.float64), misfit)


def _starts(contour: Contour, size: ClassSize, near_m: float) -> Float64:
    """(S, 5) rectangles of the usual size with all headings, their near side where it was seen."""
    heading = np.arange(STARTS) * np.pi / STARTS
    length, width = size.length_m[0], size.width_m[0]
    bearing = float(np.median(contour.bearing))
    back = 0.5 * (np.abs(np.cos(heading)) * length + np.abs(np.sin(heading)) * width)
    z = near_m + back
    return np.column_stack([bearing * z, z, heading, np.full(STARTS, length), [width] * STARTS])


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
