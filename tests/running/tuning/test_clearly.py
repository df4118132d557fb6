from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.matching_loss import Judgement
from pseudolidar.running.tuning.clearly import clearly_better, shares_of_first

FIRST = [Judgement(loss, 0.9, 0.03, 0.05) for loss in (0.04, 0.08, 0.02, 0.06)]


def changed(shares, *, density=0.9, d1_est=0.03, d1_filled=0.05):
    return [
        Judgement(share * first.loss, density, d1_est, d1_filled)
        for share, first in zip(shares, FIRST, strict=True)
    ]


def test_shares_are_of_each_frame():
    assert shares_of_first(changed((0.5, 1, 2, 0)), FIRST) == pytest.approx([0.5, 1, 2, 0])
    nothing = [Judgement(0.0, 1.0)]
    assert np.isfinite(shares_of_first(nothing, nothing)).all()


@pytest.mark.parametrize(
    ("shares", "by", "better"),
    [
        ((0.97, 0.96, 0.98, 0.97), "truth", True),
        ((0.97, 0.96, 0.98, 0.97), "scan", True),
        ((0.97, 0.96, 0.98, 0.97), "pairs", False),  # pairs must promise more
        ((0.93, 0.92, 0.95, 0.93), "pairs", True),
        ((0.99, 0.985, 0.99, 0.985), "truth", False),  # sure, but next to nothing
        ((0.7, 1.02, 1.03, 1.01), "truth", False),  # one frame only
        ((1.2, 0.5, 0.5, 0.9), "truth", False),  # by chance
        ((1.0, 1.0, 1.0, 1.0), "truth", False),
        ((np.inf, 0.1, 0.1, 0.1), "truth", False),  # nothing can be matched on one frame
    ],
)
def test_a_gain_must_be_more_than_chance(shares, by, better):
    assert clearly_better(changed(shares), FIRST, by) is better


def test_chance_cannot_be_told_of_two_frames_so_they_must_gain_more():
    sure = changed((0.97, 0.96, 0.965, 0.965))
    assert clearly_better(sure, FIRST, "truth")
    assert not clearly_better(sure[:2], FIRST[:2], "truth")
    assert clearly_better(changed((0.99, 0.8, 1, 1))[:2], FIRST[:2], "truth")
    assert not clearly_better(changed((0.999, 0.99, 1, 1))[:2], FIRST[:2], "truth")


@pytest.mark.parametrize("by", ["truth", "scan"])
@pytest.mark.parametrize("worse", [{"d1_est": 0.031}, {"d1_filled": 0.051}, {"density": 0.86}])
def test_a_lesser_loss_is_not_paid_for_with_outliers_or_gaps(worse, by):
    assert clearly_better(changed([0.8] * 4), FIRST, by)
    assert not clearly_better(changed([0.8] * 4, **worse), FIRST, by)


def test_without_a_reference_hardly_anything_may_be_left_out():
    bare = [Judgement(first.loss, 0.9) for first in FIRST]

    def of(density):
        return [Judgement(0.8 * first.loss, density) for first in FIRST]

    assert clearly_better(of(0.895), bare, "pairs")
    assert not clearly_better(of(0.875), bare, "pairs")
    assert clearly_better(changed([0.8] * 4, density=0.875), FIRST, "truth")
