"""Anything in a band of distance: `range:2-10`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.text import NUMBER
from pseudolidar.obstacles.connected import connected
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.spots import heights_m, spots_of
from pseudolidar.structures.arrays import Bool, Float32, Int64
from pseudolidar.structures.box import Detection

NEAR_THING = "obstacle"
# Neighbours belong together where their depths differ by no more than this, and sigmas of it.
STEP_M, STEP_SIGMAS = 0.15, 3.0


@dataclass(frozen=True)
class Band:
    """Distances as `2-10`, m.

    Args:
        from_m: nearest.
        to_m: farthest.
    """

    from_m: float
    to_m: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `2-10`, or `10` for all that is nearer.

        Raises:
            UsageError: no such numbers, or the wrong way round.
        """
        parts = [part.strip() for part in text.removesuffix("m").split("-")]
        if len(parts) == 1:
            parts.insert(0, "0")
        if len(parts) != 2 or not all(NUMBER.fullmatch(part) for part in parts):
            raise UsageError(f"{text!r}", want="distances such as 2-10, in m")
        near, far = (float(part) for part in parts)
        if not (0 <= near < far < math.inf):
            raise UsageError(f"{text!r}", want="the nearer distance first, such as 2-10")
        return cls(near, far)

    def __str__(self) -> str:
        return f"{self.from_m:g}-{self.to_m:g}"


@dataclass(frozen=True)
class Range:
    """Whatever is at a distance, of any class: pixels that touch, the ground left out.

    Args:
        band: distances, m: 2-10, or 10 for all that is nearer.
        least: smallest thing, the larger of its width and its height, m.
        least_pixels: that a thing has.
        above: pixels lower than this above the ground belong to it, m.
        rise: a thing is at least so high above the ground, m: kerbs and verges are less.
    """

    band: Band
    least: float = 0.1
    least_pixels: int = 60
    above: float = 0.15
    rise: float = 0.4

    def __post_init__(self) -> None:
        for name in ("least", "least_pixels", "above", "rise"):
            if not getattr(self, name) >= 0:
                raise UsageError(f"{name} {getattr(self, name)}", want="0 or more", where=name)

    def load(self) -> ThingsInRange:
        """The detector."""
        return ThingsInRange(self)


@dataclass(frozen=True)
class ThingsInRange:
    """Finds what is in the band.

    Args:
        settings: what counts as a thing.
    """

    settings: Range

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """Things, the nearest first, each with its pixels; without depth there are none."""
        depth, band, heights = sight.depth.values, self.settings.band, heights_m(sight)
        with np.errstate(invalid="ignore"):
            inside = (depth >= band.from_m) & (depth <= band.to_m) & self._standing(sight, heights)
            numbers = connected(inside, depth, _steps(sight))
        numbers = _large(numbers, self.settings.least_pixels)
        focal_px = float(sight.camera.K[0, 0])
        found = []
        for spot in spots_of(numbers):
            z = float(np.median(depth[spot.rows, spot.columns][spot.inside]))
            if spot.largest_px * z / focal_px < self.settings.least:
                continue
            if not spot.rises(heights, self.settings.rise):
                continue
            score = spot.pixels / (spot.pixels + self.settings.least_pixels)
            found.append((z, spot.detection(NEAR_THING, score, depth.shape)))
        return tuple(detection for _, detection in sorted(found, key=lambda one: one[0]))

    def _standing(self, sight: Sight, heights: Float32 | None) -> Bool:
        standing = np.ones(sight.depth.values.shape, np.bool_)
        if sight.is_ground is not None:
            standing &= ~sight.is_ground
        if heights is not None:
            standing &= heights > self.settings.above
        return standing


def _steps(sight: Sight) -> Float32:
    """(H, W) by how much the depths of neighbours on a surface may differ, m."""
    depth = sight.depth.values
    steps = np.full(depth.shape, STEP_M, np.float32)
    if sight.depth.sigma is not None:
        shared = (sight.shared_per_depth_squared * depth**2).astype(np.float32)
        own = np.sqrt(np.maximum(sight.depth.sigma**2 - shared**2, 0))
        steps += np.float32(STEP_SIGMAS) * own
    return steps


def _large(numbers: Int64, least: int) -> Int64:
    """The numbers anew from 1, things of fewer pixels left out."""
    counts = np.bincount(numbers.ravel())
    kept = counts >= max(1, least)
    kept[0] = False
    return np.where(kept, np.cumsum(kept), 0)[numbers]
