"""A pair to the disparities that its points are made of: one way for every verb that needs them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pseudolidar.geometry.rectified_pixels import unmasked
from pseudolidar.running.frame_checks import MIN_DENSITY, check_pair, check_texture
from pseudolidar.running.settings_schema import choice_name
from pseudolidar.sources.selection import whole
from pseudolidar.sources.source import FrameSequence, nearest_depth_m, pairs_of
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.filters.clean import Clean, Cleaned, Cleaner
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.map_filter import MapFilters
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.filters.temporal import Kalman
from pseudolidar.stereo.given_maps import GivenMaps
from pseudolidar.stereo.matcher import MatcherSettings, StereoMatcher
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame

# By default both rows and brightness are looked at.
BOTH_EYES = Eyes()


@dataclass(frozen=True)
class Refining:
    """What is done to matched disparities, in this order; None for nothing.

    Args:
        temporal: fused with those of the frames before.
        smooth: smoothed.
        fill: holes filled.
    """

    temporal: Kalman | None = None
    smooth: Fgs | None = None
    fill: Surfaces | None = None

    def load(
        self, matcher: StereoMatcher, source: FrameSequence[Frame]
    ) -> tuple[StereoMatcher, MapFilters]:
        """The matcher, with a memory where one is needed, and the filters behind it.

        Raises:
            NoPairs, PoseMissing: fusing needs pairs whose poses are known.
        """
        filters = MapFilters.load(self.smooth, self.fill)
        if self.temporal is None:
            return matcher, filters
        fuse = self.temporal.load(matcher, pairs_of(whole(source)))
        return fuse.sightings, filters.after(fuse)


def steps_in_words(found_by: str, refining: Refining, clean: Clean | None) -> str:
    """What finds disparities, and what is done to them: `census (quality fast) + clean`."""
    steps = (refining.temporal, refining.smooth, refining.fill, clean)
    return " + ".join([found_by, *(choice_name(type(step)) for step in steps if step is not None)])


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

    @classmethod
    def load(
        cls,
        source: FrameSequence[Frame],
        matcher: MatcherSettings,
        refining: Refining,
        clean: Clean | None,
        *,
        given: GivenMaps | None = None,
        eyes: Eyes = BOTH_EYES,
        min_depth_m: float | None = None,
    ) -> MatchFrame:
        """With everything heavy loaded that the frames of `source` need.

        Args:
            source: the frames.
            matcher: how disparities are found.
            refining: what is done to them.
            clean: what is removed of them; of given maps nothing.
            given: maps in place of a matcher.
            eyes: what is done to the pair before.
            min_depth_m: nearest depth that must be found; None for what the source says.

        Raises:
            NoPairs, PoseMissing: as `Refining.load`.
        """
        nearest_m = nearest_depth_m(min_depth_m, source)
        found = given or eyes.load(matcher, min_depth_m=nearest_m)
        # Only disparities need the kernels, and these take a second to load.
        cleaned = clean if source.yields is StereoFrame and given is None else None
        least = MIN_DENSITY if given is None else 0.0
        return cls(*refining.load(found, source), Cleaner.load(cleaned), least)

    def __call__(self, frame: StereoFrame) -> Cleaned:
        """The disparities of its left image, with the counts of all filters.

        Raises:
            PairIdentical, LowTexture: there is nothing to be seen.
        """
        check_pair(frame)
        matched = unmasked(self.matcher(frame), frame.mask)
        check_texture(frame, matched, least=self.least_density)
        refined, counts = self.refine(frame, matched)
        if refined is not matched:  # filling and fusing know nothing of the mask
            refined = unmasked(refined, frame.mask)
        cleaned = self.clean(frame, refined)
        return replace(cleaned, counts={**counts, **cleaned.counts})

    def disparity(self, frame: StereoFrame) -> DisparityMap:
        """The disparities alone; raises as the call does."""
        return self(frame).disparity
