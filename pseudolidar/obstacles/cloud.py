"""Things without an image detector: what stands on the ground, by its points alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.obstacles.birds_eye_cells import MIDDLE, TOP_M, Cells
from pseudolidar.obstacles.sight import Sight
from pseudolidar.obstacles.spots import heights_m, spots_of
from pseudolidar.structures.arrays import Bool, Float32, UInt8
from pseudolidar.structures.box import Detection

THING = "thing"


@dataclass(frozen=True)
class Cloud:
    """Whatever stands out of the ground, of any class: points near one another, seen from above.

    Args:
        reach: what is nearer to each other than this is one thing, m; farther away the error of
            depths is added.
        least: smallest thing, the larger of its width and its height, m.
        least_pixels: that a thing has.
        above: points lower than this above the ground make no thing, m: kerbs, grass.
        rise: a thing is at least so high above the ground, m.
        highest: points higher than this above the ground make no thing, m: tree tops, bridges;
            they belong to one that reaches up to them, such as a lorry.
        farthest: distance to which things are looked for, m.
    """

    reach: float = 0.4
    least: float = 0.3
    least_pixels: int = 60
    above: float = 0.3
    rise: float = 0.5
    highest: float = 2.3
    farthest: float = 60.0

    def __post_init__(self) -> None:
        for name in ("reach", "least", "least_pixels", "rise", "highest", "farthest"):
            if not getattr(self, name) > 0:
                raise UsageError(f"{name} {getattr(self, name)}", want="more than 0", where=name)
        if not 0 <= self.above < self.highest:
            raise UsageError(
                f"above {self.above:g} m", want=f"0 to {self.highest:g} m, `highest`", where="above"
            )

    def load(self) -> CloudThings:
        """The detector."""
        return CloudThings(self)


@dataclass(frozen=True)
class CloudThings:
    """Finds things by their points.

    Args:
        settings: what counts as one.
    """

    settings: Cloud

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """Things, the nearest first, each with its pixels; without depth there are none."""
        depth, heights = sight.depth.values, heights_m(sight)
        standing = _standing(sight, heights) & (depth < self.settings.farthest)
        cells = Cells.of(sight, self.settings.reach, _own_per_depth_squared(sight))
        numbers = cells.clusters(depth, standing, self._levels(heights, depth.shape))
        focal_px = float(sight.camera.K[1, 1])
        found = []
        for spot in (one.whole() for one in spots_of(numbers)):
            if spot.pixels < self.settings.least_pixels:
                continue
            z = float(np.median(depth[spot.rows, spot.columns][spot.inside]))
            if spot.largest_px * z / focal_px < self.settings.least:
                continue
            if not spot.rises(heights, self.settings.rise):
                continue
            score = spot.pixels / (spot.pixels + self.settings.least_pixels)
            found.append((z, spot.detection(THING, score, depth.shape)))
        return tuple(detection for _, detection in sorted(found, key=lambda one: one[0]))

    def _levels(self, heights: Float32 | None, size: tuple[int, ...]) -> UInt8:
        """(H, W) which part each pixel has in making things, by its height."""
        if heights is None:
            return np.full(size, MIDDLE, np.uint8)
        top = max(self.settings.above, self.settings.highest - TOP_M)
        edges = np.array([self.settings.above, top, self.settings.highest])
        return np.asarray(np.searchsorted(edges, heights), np.uint8)


def _standing(sight: Sight, heights: Float32 | None) -> Bool:
    """(H, W) pixels that have a depth and are no ground."""
    standing = sight.depth.valid
    if sight.is_ground is not None:
        standing &= ~sight.is_ground
    if heights is not None:
        standing &= heights > 0
    return standing


def _own_per_depth_squared(sight: Sight) -> float:
    """Sigma of one depth against its neighbours' over its square, 1/m."""
    if sight.depth.sigma is None:
        return sight.untold_per_depth_squared
    sparse = sight.depth.values[::4, ::4], sight.depth.sigma[::4, ::4]
    relative = (sparse[1] / sparse[0] ** 2)[np.isfinite(sparse[0]) & np.isfinite(sparse[1])]
    if not len(relative):
        return sight.untold_per_depth_squared
    shared = sight.shared_per_depth_squared
    return float(np.sqrt(max(np.median(relative) ** 2 - shared**2, (0.1 * shared) ** 2, 1e-12)))
