"""Whether things are nearer than a run looks for them, and from where on it should look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from pseudolidar.calibration.check import PairCheck
from pseudolidar.calibration.check_finding import Finding
from pseudolidar.sources.source import FrameSequence, FrameSource, nearest_depth_m
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.disparity_range import disparity_range
from pseudolidar.stereo.matcher import MatcherSettings
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import typed_below
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame

NEAREST = "nearest depth"
# Fewer matches of all pairs together tell nothing.
LEAST_MATCHES = 40
# Share and number of the matches beyond the range that are worth a line. Of 83 pairs of KITTI none
# has a single one, of the rendered worlds one match in 900; of pictures of a board held before the
# cameras 9 to 100 %.
BEYOND_SHARE, LEAST_BEYOND = 0.02, 10
# The range is to hold this share of the matches, with something over: some pairs were looked at.
HELD_SHARE, HEADROOM = 0.98, 1.2


@dataclass(frozen=True)
class Searching:
    """What disparities are looked for.

    Args:
        matcher: that looks.
        min_depth_m: nearest depth that is asked for, m; None for what the source says.
    """

    matcher: MatcherSettings
    min_depth_m: float | None = None

    def disparities(self, source: FrameSource) -> int | None:
        """How many are searched in the pairs of a source; None of networks, which see all."""
        match self.matcher:
            case Census() | Sgbm() | Bm():
                nearest_m = nearest_depth_m(self.min_depth_m, source)
                return self.matcher.disparities or disparity_range(source.rig, nearest_m)
        return None

    def searched_px(self, source: FrameSequence[Frame]) -> int | None:
        """Where the disparities of a source end, px; None where there is no such end."""
        if source.yields is not StereoFrame:
            return None
        return self.disparities(cast(FrameSource, source))

    @property
    def fixed(self) -> bool:
        """Whether the range is said in pixels."""
        return isinstance(self.matcher, Census | Sgbm | Bm) and self.matcher.disparities is not None


def nearest_found(
    pairs: Sequence[PairCheck], source: FrameSource, searching: Searching
) -> Finding | None:
    """Judge what is searched by how near the matches of all pairs together are.

    Args:
        pairs: what was looked at.
        source: they are of.
        searching: what a run will look for.

    Returns:
        None where nothing is searched, or metres mean nothing.
    """
    rig = source.rig
    searched_px = searching.disparities(source)
    if searched_px is None or not rig.metric:
        return None
    seen_px = np.concatenate([np.zeros(0), *(pair.depths_px for pair in pairs)])
    n, beyond = len(seen_px), int(np.sum(seen_px >= searched_px))
    searched_m = _depth_m(rig, searched_px)
    figures: dict[str, float | int | None] = {
        "matches": n,
        "searched_from_m": searched_m,
        "disparities": searched_px,
    }
    if n < LEAST_MATCHES:
        return Finding(NEAREST, "unknown", f"cannot tell: {n} matches", figures=figures)
    share = beyond / n
    held_px = float(np.quantile(seen_px, HELD_SHARE))
    figures |= {"nearer": share, "nearest_seen_m": _depth_m(rig, held_px)}
    if share < BEYOND_SHARE or beyond < LEAST_BEYOND:
        text = f"{searched_m:.3g} m and farther is searched, and nothing nearer is seen"
        return Finding(NEAREST, "good", text, None, "", figures)
    text = f"{share:.0%} of {n} matches are nearer than the {searched_m:.2g} m that are searched"
    mend = _mend(rig, seen_px, searched_px, searching)
    return Finding(NEAREST, "warn", text, None, mend, figures)


def _mend(rig: StereoRig, seen_px: Float64, searched_px: int, searching: Searching) -> str:
    """What to do so that what is seen is found."""
    needed_px = float(np.quantile(seen_px, HELD_SHARE)) * HEADROOM
    most_px = disparity_range(rig, 1e-6)
    if searched_px >= most_px:
        return "No more than half the width of pictures is searched: nearer things are not found."
    depth_m = typed_below(_depth_m(rig, needed_px))
    while disparity_range(rig, depth_m) < min(needed_px, most_px):  # it rounds to either side
        depth_m = typed_below(depth_m * (1 - 1e-6))
    if searching.fixed:
        return f"Leave --matcher.disparities out and pass --min-depth {depth_m:g}."
    return f"Pass --min-depth {depth_m:g}."


def _depth_m(rig: StereoRig, disparity_px: float) -> float:
    return rig.fB_px_m / max(disparity_px + rig.doffs_px, 1e-3)
