"""The near side of an object as seen from above: a depth for each direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.frustum import Frustum
from pseudolidar.structures.arrays import Float64

# Heights above the ground at which most things have upright sides: bumpers and doors, legs and
# walls; roofs and windscreens lean.
UPRIGHT_M = (0.25, 1.3)
# The band is used where so much of the object is in it.
LEAST_IN_BAND, LEAST_PIXELS = 0.1, 10
# Directions that are told apart, and pixels of each.
MOST_BEARINGS, LEAST_PER_BEARING = 48, 2
# Bumpers, mirrors and arms stand out of sides: the side of a box around what is round is where this
# share of the points of a direction is nearer; of flat things, where half are.
FRONT, FLAT = 0.2, 0.5
# Pixels of a square with this side are matched by much the same windows and share their errors.
PATCH_PX = 9.0
# Half of the directions of what is flat lie within so many sigmas, or this share of the depth.
FLAT_SIGMAS, FLAT_REL = 2.0, 0.02
# Unevenness of flat things, m.
LEAST_ROUGH_M = 0.02
# Directions that stand for a thing that faces the camera.
FACING = 7


@dataclass(frozen=True, eq=False)
class Contour:
    """Depths of the upright part of an object by direction, from above.

    Args:
        bearing: (B,) x / z of each direction.
        depth_m: (B,) Z of the side of a box there.
        sigma_m: (B,) one standard deviation of that against a flat side.
        independent: how many measurements they are worth: neighbours share their errors.
    """

    bearing: Float64
    depth_m: Float64
    sigma_m: Float64
    independent: float

    def __len__(self) -> int:
        return len(self.bearing)

    @property
    def near_m(self) -> float:
        """About where it is nearest."""
        return float(np.quantile(self.depth_m, 0.1))

    @property
    def is_flat(self) -> bool:
        """Whether it is all at one depth, as far as its errors tell."""
        low, high = np.quantile(self.depth_m, (0.25, 0.75))
        allowed_m = max(FLAT_SIGMAS * float(np.median(self.sigma_m)), FLAT_REL * float(low))
        return float(high - low) <= allowed_m


def upright_part(pixels: Frustum) -> Frustum:
    """Those at heights where sides are upright, if there are enough; else all."""
    low, high = UPRIGHT_M
    inside = (pixels.height_m > low) & (pixels.height_m < high)
    enough = max(LEAST_PIXELS, LEAST_IN_BAND * len(pixels))
    return pixels[inside] if np.count_nonzero(inside) >= enough else pixels


def contour_of(pixels: Frustum, bearing: Float64, round_m: float) -> Contour:
    """The near side of an object.

    Args:
        pixels: N of it, N > 0.
        bearing: (N,) x / z of each.
        round_m: how far the surface lies behind the faces of a box around it.
    """
    low, high = float(bearing.min()), float(bearing.max())
    count = int(np.clip(len(np.unique(bearing)), 1, MOST_BEARINGS))
    bins = np.minimum(((bearing - low) / max(high - low, 1e-9) * count).astype(int), count - 1)
    order = np.lexsort((pixels.depth_m, bins))
    starts = np.searchsorted(bins[order], np.arange(count + 1))
    sizes = np.diff(starts)
    kept = np.flatnonzero(sizes >= min(LEAST_PER_BEARING, int(sizes.max())))
    share = FRONT if round_m else FLAT
    front = order[starts[kept] + (share * sizes[kept]).astype(int)]
    sigma = np.hypot(pixels.sigma_m[front], max(round_m, LEAST_ROUGH_M))
    independent = float(np.clip(len(pixels) / PATCH_PX**2, 1.0, len(front)))
    return Contour(bearing[front], pixels.depth_m[front] - round_m, sigma, independent)


def flat_contour(left: float, right: float, depth_m: float, sigma_m: float) -> Contour:
    """That of a thing that faces the camera, known at one depth.

    Args:
        left: bearing of its left edge.
        right: of its right one.
        depth_m: Z.
        sigma_m: one standard deviation.
    """
    bearing = np.linspace(left, right, FACING + 2)[1:-1]
    same = np.ones(FACING)
    return Contour(bearing, depth_m * same, sigma_m * same, 1.0)
