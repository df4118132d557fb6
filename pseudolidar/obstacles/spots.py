"""Numbered pixels of a picture as things with a box and a mask."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Bool, Float32, Int64
from pseudolidar.structures.box import Detection

# Rows and columns at a rim that together hold no more than this share of the pixels are strays.
STRAY = 0.005
# And this share of the highest for how high a thing is.
STRAY_TOP = 0.05
# A part of a thing with fewer of its pixels than this is a speck; gaps up to this width are none.
SPECK, BESIDE_PX = 0.05, 7


@dataclass(frozen=True, eq=False)
class Spot:
    """Pixels of one thing.

    Args:
        rows: of the window that holds them.
        columns: of it.
        inside: (h, w) which pixels of the window they are.
    """

    rows: slice
    columns: slice
    inside: Bool

    @property
    def pixels(self) -> int:
        """How many."""
        return int(np.count_nonzero(self.inside))

    @property
    def box_px(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom, strays left out."""
        top, bottom = _span(self.inside.sum(axis=1), self.rows.start)
        left, right = _span(self.inside.sum(axis=0), self.columns.start)
        return left, top, right, bottom

    @property
    def largest_px(self) -> float:
        """The larger side of the box."""
        left, top, right, bottom = self.box_px
        return max(right - left, bottom - top) + 1

    def whole(self) -> Spot:
        """Without specks far from its parts; the parts of a thing behind a pole are kept."""
        import cv2

        around = cv2.dilate(self.inside.astype(np.uint8), np.ones((BESIDE_PX, BESIDE_PX), np.uint8))
        _, parts = cv2.connectedComponents(around)
        parts[~self.inside] = 0
        counts = np.bincount(parts.ravel())
        counts[0] = 0
        kept = counts >= SPECK * counts.sum()
        return Spot(self.rows, self.columns, kept[parts])

    def rises(self, heights: Float32 | None, least_m: float) -> bool:
        """Whether its top is so high above the ground; true where there is no ground."""
        if heights is None:
            return True
        own = heights[self.rows, self.columns][self.inside]
        return bool(np.quantile(own, 1 - STRAY_TOP) >= least_m)

    def detection(self, name: str, score: float, size: tuple[int, ...]) -> Detection:
        """As a detection in a picture of `size` (H, W)."""
        mask = np.zeros(size, np.bool_)
        mask[self.rows, self.columns] = self.inside
        return Detection(name, self.box_px, score, mask)


def spots_of(numbers: Int64) -> Iterator[Spot]:
    """The things of a numbered picture (H, W), in the order of their numbers; 0 is none."""
    from scipy.ndimage import find_objects

    for number, window in enumerate(find_objects(numbers), start=1):
        if window is not None:
            rows, columns = window
            yield Spot(rows, columns, numbers[window] == number)


def heights_m(sight: Sight) -> Float32 | None:
    """(H, W) above the ground; NaN without depth. None where there is no ground."""
    if sight.ground is None:
        return None
    heights = sight.ground.heights_m(sight.xyz.reshape(-1, 3))
    return np.asarray(heights.reshape(sight.depth.values.shape), np.float32)


def _span(counts: Int64, first: int) -> tuple[float, float]:
    """First and last place with more than strays before and after."""
    total = np.cumsum(counts)
    low = int(np.searchsorted(total, STRAY * total[-1], side="right"))
    high = int(np.searchsorted(total, (1 - STRAY) * total[-1], side="left"))
    return float(first + low), float(first + max(low, high))
