"""What every filter of dense maps is, and the row of them that a frame passes through."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self

import numpy as np

from pseudolidar.geometry.grey import shift_to_8_bits
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.arrays import AnyArray, Float32, UInt8
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Sigma of a map whose matcher states none, px: that of a usual pixel of a usual matcher.
USUAL_SIGMA_PX = 0.5


class Filtered(NamedTuple):
    """A disparity map, and what filters did to it.

    Args:
        disparity: the map.
        counts: pixels by what was done to them, for the report.
    """

    disparity: DisparityMap
    counts: Mapping[str, int]


class MapFilter(Protocol):
    """A loaded filter; pure, picklable, safe to call from several threads at once."""

    def __call__(self, frame: StereoFrame, disparity: DisparityMap) -> Filtered:
        """The map of `frame`'s left image, filtered, with sigma where it had one."""


class MapFilterSettings(Protocol):
    """Settings of a filter."""

    def load(self) -> MapFilter:
        """The filter, with everything heavy loaded."""


@dataclass(frozen=True)
class MapFilters:
    """Filters in a row.

    Args:
        filters: the first sees what the matcher found.
    """

    filters: tuple[MapFilter, ...] = ()

    @classmethod
    def load(cls, *chosen: MapFilterSettings | None) -> Self:
        """Those that are chosen, in this order."""
        return cls(tuple(settings.load() for settings in chosen if settings is not None))

    def after(self, first: MapFilter) -> Self:
        """The same with another one in front."""
        return replace(self, filters=(first, *self.filters))

    def __call__(self, frame: StereoFrame, disparity: DisparityMap) -> Filtered:
        """Pass the map through all of them; counts of all together."""
        counts: dict[str, int] = {}
        for one in self.filters:
            filtered = one(frame, disparity)
            disparity = filtered.disparity
            counts |= filtered.counts
        return Filtered(disparity, counts)


@dataclass(frozen=True)
class FilteredMatcher:
    """A matcher and the filters behind it, as one matcher."""

    matcher: StereoMatcher
    filters: MapFilters

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """Match, then filter."""
        return self.filters(frame, self.matcher(frame)).disparity


def sigma_or_usual(disparity: DisparityMap) -> Float32:
    """(H, W) the map's sigma, NaN where there is no disparity."""
    if disparity.sigma is not None:
        return disparity.sigma
    return np.where(disparity.valid, np.float32(USUAL_SIGMA_PX), np.float32(np.nan))


def picture8(frame: StereoFrame) -> UInt8:
    """(H, W, C) the left image in 8 bits."""
    image: AnyArray = frame.left
    if image.dtype != np.uint8:
        image = image >> shift_to_8_bits(frame.left, frame.right)
    stacked = image[:, :, None] if image.ndim == 2 else image
    return np.ascontiguousarray(stacked, np.uint8)
