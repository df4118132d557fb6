"""Whether settings are clearly better than the first ones, on frames that were not tuned on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.evaluation.disparity import mean_known
from pseudolidar.evaluation.matching_loss import Judgement
from pseudolidar.structures.arrays import Float64

# Shares of the first settings' loss that must be gained: by a reference on frames enough to tell
# chance, and else. Pairs alone rank settings worse than a reference does: of what they would pick
# on 18 worlds and matchers, 8 promised 0.05 or more and were better by truth by 0.1 and more; the
# others were anything from 0.09 worse to 0.1 better. On two frames of KITTI a gain of 0.05 by truth
# was 0.02 on six others, one of 0.034 by scans nothing.
GAIN_SURE, GAIN_UNSURE = 0.02, 0.05
# The gain must be more than chance, with this probability (Student's t over the frames), where
# there are frames enough to tell chance.
CERTAINTY, LEAST_FRAMES = 0.95, 3
# Share of the pixels that may be left out besides those that the first settings leave out: without
# a reference nobody can say that they were wrong.
LEFT_OUT_BY_REFERENCE, LEFT_OUT_BY_PAIRS = 0.03, 0.02
# A loss that is no less, so that shares of it are finite.
LEAST_LOSS = 1e-9


def shares_of_first(own: Sequence[Judgement], first: Sequence[Judgement]) -> Float64:
    """(F,) the loss of each frame as a share of the first settings' loss there."""
    pairs = zip(own, first, strict=True)
    return np.array([mine.loss / max(usual.loss, LEAST_LOSS) for mine, usual in pairs])


def clearly_better(own: Sequence[Judgement], first: Sequence[Judgement], by: str) -> bool:
    """Whether settings may take the place of the first ones.

    Their loss is less by more than chance, and they pay for it nowhere else: neither outliers
    among matched pixels nor outliers with gaps filled become more, nor much fewer pixels matched.

    Args:
        own: how they were judged on the frames that were held back.
        first: how the first settings were, on the same frames.
        by: what they were compared with: truth, scan or pairs.
    """
    alone = by == "pairs"
    gained = 1 - shares_of_first(own, first)
    few = len(gained) < LEAST_FRAMES
    if not gained.mean() >= (GAIN_UNSURE if alone or few else GAIN_SURE):
        return False
    if not few and not gained.mean() > _by_chance(gained):
        return False
    mine, usual = (float(np.mean([each.density for each in part])) for part in (own, first))
    if mine < usual - (LEFT_OUT_BY_PAIRS if alone else LEFT_OUT_BY_REFERENCE):
        return False
    return all(_no_more(own, first, name) for name in ("d1_est", "d1_filled"))


def _by_chance(gained: Float64) -> float:
    """The mean gain that settings no better than the first have once in twenty times or less."""
    from scipy.stats import t

    spread = float(gained.std(ddof=1)) / np.sqrt(len(gained))
    return float(t.ppf(CERTAINTY, len(gained) - 1)) * float(spread)


def _no_more(own: Sequence[Judgement], first: Sequence[Judgement], name: str) -> bool:
    mine, usual = (mean_known([getattr(each, name) for each in part]) for part in (own, first))
    return mine is None or usual is None or mine <= usual
