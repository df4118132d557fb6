"""A pair to the disparities that its points are made of."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.running.frame_checks import check_pair, check_texture
from pseudolidar.stereo.filters.clean import Cleaner
from pseudolidar.stereo.filters.map_filter import MapFilters
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame


@dataclass(frozen=True)
class MatchFrame:
    """Matches, refines, cleans: pure, picklable, one thread.

    Args:
        matcher: pair to disparity.
        refine: disparity to a smoother or denser one.
        clean: disparity without what is no surface.
        least_density: share of pixels that must have a disparity: given maps may be sparse.
    """

    matcher: StereoMatcher
    refine: MapFilters
    clean: Cleaner
    least_density: float

    def __call__(self, frame: StereoFrame) -> DisparityMap:
        """The disparities of its left image.

        Raises:
            PairIdentical, LowTexture: there is nothing to be seen.
        """
        check_pair(frame)
        matched = self.matcher(frame)
        check_texture(frame, matched, least=self.least_density)
        return self.clean(frame, self.refine(frame, matched).disparity).disparity
