"""The nearest thing in a corridor ahead, whatever it is: what a vehicle must not run into."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.text import NUMBER
from pseudolidar.obstacles.level import level_axes, turned
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Float64, UInt8

# Lower than this above the ground a wheel runs over things, m.
CLEARANCE_M = 0.2
# A thing is what fills this square at one depth, m, and so many pixels.
LEAST_SIDE_M, LEAST_PIXELS = 0.15, 12
# One depth: this, and so many sigmas.
THICK_M, THICK_SIGMAS = 0.3, 2.0
# Points of a thing nearer than its front: this share.
FRONT = 0.1
# From this probability on a thing counts as too near: its distance less one sigma.
STOP_CHANCE = 0.16
# Pixels of a square with this side share their errors.
PATCH_PX = 9.0


@dataclass(frozen=True)
class Corridor:
    """A box ahead of the camera, written `WIDTHxHEIGHTxLENGTH`, m.

    It is as wide to both sides. Where there is a ground its height is above that, from 0.2 m on;
    else half of it is above the camera.

    Args:
        width_m: across.
        height_m: upwards.
        length_m: ahead.
    """

    width_m: float
    height_m: float
    length_m: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `2x2x30`.

        Raises:
            UsageError: not three numbers above 0.
        """
        parts = text.lower().split("x")
        good = len(parts) == 3 and all(NUMBER.fullmatch(part) for part in parts)
        if not good or min(float(part) for part in parts) <= 0:
            raise UsageError(f"{text!r}", want="WIDTHxHEIGHTxLENGTH in m, such as 2x2x30")
        width_m, height_m, length_m = (float(part) for part in parts)
        return cls(width_m, height_m, length_m)

    def heights_m(self, sight: Sight) -> tuple[float, float, float]:
        """Of the camera, of its lower and of its upper side: above the ground, else the camera."""
        if sight.ground is not None:
            return sight.ground.offset_m, CLEARANCE_M, self.height_m
        return 0.0, -0.5 * self.height_m, 0.5 * self.height_m

    def corners_m(self, sight: Sight) -> Float64:
        """(8, 3) corners in the camera's frame, in the order of `Box3D.corners_m`."""
        eye_m, low_m, high_m = self.heights_m(sight)
        half_m = 0.5 * self.width_m
        level = [
            (x, y, z)
            for x in (-half_m, half_m)
            for y in (eye_m - low_m, eye_m - high_m)
            for z in (0.0, self.length_m)
        ]
        return turned(level_axes(sight).T, np.array(level))

    def __str__(self) -> str:
        return f"{self.width_m:g}x{self.height_m:g}x{self.length_m:g}"


@dataclass(frozen=True)
class Ahead:
    """The nearest thing in a corridor.

    Args:
        distance_m: Z of its front.
        sigma_m: one standard deviation.
        points: pixels that show it.
        across_m: where it is, to the right of the camera.
        up_m: above the camera.
        bound: it is so near that the search for disparities ends there: it may be nearer.
    """

    distance_m: float
    sigma_m: float
    points: int
    across_m: float
    up_m: float
    bound: bool = False

    def nearer_than(self, limit_m: float) -> float:
        """How sure it is nearer than this, 0-1, errors taken for normal; 1 where nobody knows."""
        if self.bound:
            return 1.0
        return 0.5 * math.erfc((self.distance_m - limit_m) / (math.sqrt(2.0) * self.sigma_m))


@dataclass(frozen=True)
class StopRule:
    """When a vehicle must stop.

    Args:
        limit_m: nothing in the corridor may be nearer.
        chance: it is too near from this probability on, 0-1.
    """

    limit_m: float
    chance: float

    def broken_by(self, ahead: Ahead | None) -> bool:
        """Whether something may well be too near."""
        return ahead is not None and ahead.nearer_than(self.limit_m) >= self.chance


def nearest_ahead(sight: Sight, corridor: Corridor) -> Ahead | None:
    """The nearest thing in the corridor; None where nothing is seen in it.

    A thing is what has enough pixels at one depth for a square of 15 cm: single pixels are none.
    """
    xyz, sigma_m = _inside(sight, corridor)
    if len(xyz) < LEAST_PIXELS:
        return None
    order = np.argsort(xyz[:, 2], kind="stable")
    xyz, sigma_m = xyz[order], sigma_m[order]
    z = xyz[:, 2]
    until = np.searchsorted(z, z + THICK_M + THICK_SIGMAS * sigma_m, side="right")
    counts = until - np.arange(len(z))
    K = sight.camera.K
    wanted = np.maximum(LEAST_PIXELS, LEAST_SIDE_M**2 * K[0, 0] * K[1, 1] / z**2)
    enough = np.flatnonzero(counts >= wanted)
    if not len(enough):
        return None
    first = int(enough[0])
    thing = slice(first, int(until[first]))
    front = first + int(FRONT * counts[first])
    shared_m = sight.shared_per_depth_squared * float(z[front]) ** 2
    own = math.sqrt(max(float(sigma_m[front]) ** 2 - shared_m**2, 0.0))
    independent = max(1.0, float(counts[first]) / PATCH_PX**2)
    x, y, _ = np.median(xyz[thing], axis=0)
    return Ahead(
        float(z[front]),
        math.hypot(own / math.sqrt(independent), shared_m, 0.01),
        int(counts[first]),
        float(x),
        float(-y),
        sight.may_be_nearer(z[thing]),
    )


def near_mask(sight: Sight, nearer_than_m: float) -> UInt8:
    """(H, W) 255 where something that is no ground is nearer than this, else 0."""
    near = np.nan_to_num(sight.depth.values, nan=np.inf) < nearer_than_m
    if sight.is_ground is not None:
        near &= ~sight.is_ground
    return np.where(near, np.uint8(255), np.uint8(0))


def _inside(sight: Sight, corridor: Corridor) -> tuple[Float64, Float64]:
    """(N, 3) points of the corridor in level axes, and (N,) their sigma, m."""
    known = sight.depth.valid & (sight.depth.values < 1.5 * corridor.length_m)
    if sight.is_ground is not None:
        known &= ~sight.is_ground
    xyz = turned(level_axes(sight), sight.xyz[known])
    sigma_m = sight.sigma_m[known].astype(np.float64)
    eye_m, low_m, high_m = corridor.heights_m(sight)
    up = eye_m - xyz[:, 1]
    inside = (np.abs(xyz[:, 0]) <= 0.5 * corridor.width_m) & (xyz[:, 2] <= corridor.length_m)
    inside &= (up > low_m) & (up < high_m)
    return xyz[inside], sigma_m[inside]
