"""Which things wrong with a rig explain its depth errors, and which cannot be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.diagnosis.blocks import ErrorBlocks, error_blocks
from pseudolidar.evaluation.diagnosis.causes import CAUSES
from pseudolidar.evaluation.diagnosis.fits import CauseFits, Explanation
from pseudolidar.evaluation.ranges import RANGE_BINS_M
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig

# Causes that are looked for at the same time; more are never told apart.
MOST_CAUSES = 3
# Fewer blocks than this carry no diagnosis.
MIN_BLOCKS = 40
# Losses that differ by fewer standard errors, or by less than this, are alike: matchers alone make
# patterns of some hundredths of a pixel.
ALIKE_SIGMAS, ALIKE_PX = 1.0, 0.03
MOST_ALTERNATIVES = 3
# Causes that explain less than this share of the error leave most of it; so small an error left is
# none of the rig.
MOSTLY, BY_MATCHERS_PX = 0.5, 0.1
UNKNOWN = "most of it has another form than these causes make: lenses, or the matching, make such"


@dataclass(frozen=True)
class BiasShare:
    """Depth bias of one range, and what the causes make of it.

    Args:
        from_m: nearest depth.
        to_m: farthest.
        bias_rel: median relative depth error; None without points.
        explained_rel: what the causes predict of it.
    """

    from_m: int
    to_m: int
    bias_rel: float | None
    explained_rel: float | None


@dataclass(frozen=True)
class Diagnosis:
    """What is wrong with a rig.

    Args:
        chosen: the simplest explanation of those that hold on frames outside the fit; of equally
            simple ones one whose causes do not cancel each other, if there is one.
        alternatives: other explanations with as many causes that the data do not tell from it.
        single: what each cause explains alone, the most first.
        systematic_px: typical systematic error of a block, px (median of absolute values).
        unexplained_px: what the chosen causes leave of it.
        bias: by range.
    """

    chosen: Explanation
    alternatives: tuple[Explanation, ...]
    single: tuple[Explanation, ...]
    systematic_px: float
    unexplained_px: float
    bias: tuple[BiasShare, ...]

    @property
    def mostly_unknown(self) -> bool:
        """Whether the causes leave most of the error, and more than matchers make by themselves."""
        left = self.chosen.explained < MOSTLY and self.unexplained_px > BY_MATCHERS_PX
        return bool(self.chosen.causes) and left

    def text(self) -> str:
        """For people, a few lines."""
        lines = [f"systematic disparity error {self.systematic_px:.2f} px (median of blocks)"]
        if not self.chosen.causes:
            return f"{lines[0]}: the rig is healthy, no cause explains more than chance"
        effect = self.chosen.effect
        how = "fits a sum, of" if effect.cancels else "explained by:"
        causes = "; ".join(found.text for found in self.chosen.causes)
        lines.append(f"{self.chosen.explained:.0%} of it {how} {causes}")
        if effect.cancels:
            lines.append(f"{effect.text}: only the sum is sure, none of them is found for itself")
        if self.mostly_unknown:
            lines.append(UNKNOWN)
        for found in self.chosen.causes:
            if found.twins:
                names = " or ".join(name.replace("_", " ") for name in found.twins)
                lines.append(
                    f"{found.cause.name.replace('_', ' ')} may as well be {names}, in part"
                )
        for other in self.alternatives[:MOST_ALTERNATIVES]:
            causes = "; ".join(found.text for found in other.causes)
            sums = ", as a sum" if other.effect.cancels else ""
            lines.append(f"not told apart from: {causes} ({other.explained:.0%}{sums})")
        if len(self.alternatives) > MOST_ALTERNATIVES:
            lines.append(f"and {len(self.alternatives) - MOST_ALTERNATIVES} more like these")
        lines.append(f"left unexplained: {self.unexplained_px:.2f} px")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """For programs."""
        return {
            "chosen": self.chosen.as_dict(),
            "alternatives": [other.as_dict() for other in self.alternatives],
            "single": [one.as_dict() for one in self.single],
            "systematic_px": self.systematic_px,
            "unexplained_px": self.unexplained_px,
            "mostly_unknown": self.mostly_unknown,
            "bias": [vars(share) for share in self.bias],
        }


def diagnose(frames: Sequence[ComparedFrame]) -> Diagnosis | None:
    """Find the fewest causes that explain the systematic error of frames of one rig.

    Each set of up to three causes is fitted to medians of blocks, robustly, and judged on frames
    (of a single one, columns of blocks) outside the fit. Chosen is the smallest set whose loss is
    within one standard error of the best; sets as small and as good cannot be told from it.

    Args:
        frames: compared with a reference; their rig's correction counts as part of the rig.

    Returns:
        None where too few blocks have points.
    """
    blocks = error_blocks(frames)
    if len(blocks) < MIN_BLOCKS:
        return None
    rig = frames[0].rig
    fits = CauseFits(blocks, rig)
    sets = [s for n in range(MOST_CAUSES + 1) for s in combinations(range(len(CAUSES)), n)]
    losses = {s: fits.held_out(s) for s in sets}
    best = min(sets, key=lambda s: float(losses[s].mean()))
    good = [s for s in sets if _alike(losses[s], losses[best])]
    fewest = min(len(s) for s in good)
    # causes that cancel each other are named last: of such sums the parts are hardly known
    peers = sorted(
        (s for s in good if len(s) == fewest),
        key=lambda s: (fits.effect(s).cancels, float(losses[s].mean())),
    )
    chosen = fits.explanation(peers[0], losses)
    single = sorted(
        (fits.explanation((i,), losses) for i in range(len(CAUSES))), key=lambda e: -e.explained
    )
    residual = blocks.error_px - fits.predicted(peers[0])
    return Diagnosis(
        chosen=chosen,
        alternatives=tuple(fits.explanation(s, losses) for s in peers[1:]),
        single=tuple(single),
        systematic_px=float(np.median(np.abs(blocks.error_px))),
        unexplained_px=float(np.median(np.abs(residual))),
        bias=_bias_shares(blocks, rig, fits.predicted(peers[0])),
    )


def _alike(losses: Float64, best: Float64) -> bool:
    """Whether losses by part are larger than those of the best by no more than chance."""
    more = losses - best
    chance = ALIKE_SIGMAS * more.std(ddof=1) / np.sqrt(len(more))
    return bool(more.mean() <= max(chance, ALIKE_PX))


def _bias_shares(
    blocks: ErrorBlocks, rig: StereoRig, explained_px: Float64
) -> tuple[BiasShare, ...]:
    """Relative depth bias by range: dz / z = -error / (d + doffs), of blocks."""
    d = blocks.reference_px + rig.doffs_px
    depth_m = rig.fB_px_m / d
    shares = []
    for low, high in RANGE_BINS_M:
        inside = (depth_m >= low) & (depth_m < high)
        if not inside.any():
            shares.append(BiasShare(low, high, None, None))
            continue
        bias, part = (
            float(np.median((d / (d + error) - 1.0)[inside]))
            for error in (blocks.error_px, explained_px)
        )
        shares.append(BiasShare(low, high, bias, part))
    return tuple(shares)
