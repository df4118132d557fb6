from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.matching_loss import (
    GAP_COST,
    RIGHT_COST,
    WRONG_GAP_COST,
    as_the_rig_has_it,
    judged_by_reference,
)

ROWS = np.ones(40, bool)


def reference():
    rng = np.random.default_rng(0)
    values = rng.uniform(5, 60, (40, 60)).astype(np.float32)
    values[:, :10] = np.nan
    return values


def loss(values, truth):
    return judged_by_reference(values, truth, ROWS).loss


def test_what_is_right_costs_by_its_error_and_never_more_than_a_gap():
    truth = reference()
    assert loss(truth, truth) == 0.0
    assert loss(truth + 1.5, truth) == pytest.approx(RIGHT_COST / 2, rel=1e-5)
    assert loss(truth + 2.9, truth) < loss(np.full_like(truth, np.nan), truth)
    assert RIGHT_COST <= GAP_COST
    near = np.full_like(truth, 100.0)  # 5 % of it are no outlier
    assert loss(near + 4, near) == pytest.approx(RIGHT_COST)
    assert loss(near + 6, near) == loss(truth + 40, truth) == 1.0


def test_a_gap_costs_what_filling_it_would_be_worth():
    truth = np.full((40, 60), 20.0, np.float32)
    gap = truth.copy()
    gap[:, 30:45] = np.nan
    found = judged_by_reference(gap, truth, ROWS)
    assert (found.loss, found.density) == (pytest.approx(GAP_COST / 4), 0.75)
    assert (found.d1_est, found.d1_filled) == (0.0, 0.0)
    truth[:, 30:45] = 50.0  # what is left out is not what is around it
    found = judged_by_reference(gap, truth, ROWS)
    assert found.loss == pytest.approx(WRONG_GAP_COST / 4)
    assert found.d1_filled == 0.25
    wrong = np.where(np.isfinite(gap), gap, 80.0)
    assert GAP_COST < WRONG_GAP_COST < 4 * loss(wrong, truth)


def test_sparse_maps_pay_for_what_they_leave_out():
    """Errors of 0.8 px, as many right pixels of KITTI have: no reason to leave them out."""
    truth = reference()
    noise = np.random.default_rng(2).choice([-0.8, 0.8], truth.shape).astype(np.float32)
    dense = truth + noise
    sparse = np.where(np.random.default_rng(3).random(truth.shape) < 0.2, np.nan, dense)
    assert loss(sparse, truth) > 1.5 * loss(dense, truth)


def test_only_the_rows_that_count_do():
    truth = reference()
    off = truth.copy()
    off[20:] += 10
    upper = np.arange(40) < 20
    assert judged_by_reference(off, truth, upper).loss == 0.0
    assert judged_by_reference(off, truth, ~upper).loss == 1.0
    assert judged_by_reference(off, truth, ~upper).d1_est == 1.0
    with pytest.raises(ReferenceMissing):
        judged_by_reference(off, np.full_like(truth, np.nan), ROWS)


def test_what_the_rig_is_off_by_is_not_the_settings():
    truth = np.tile(np.linspace(4, 60, 200, dtype=np.float32), (40, 1))
    rng = np.random.default_rng(1)
    measured = (truth - 0.5 + rng.normal(0, 0.1, truth.shape)).astype(np.float32)
    measured[:, 100:120] = np.nan
    shifted = as_the_rig_has_it(truth, measured)
    assert shifted - truth == pytest.approx(-0.5, abs=0.03)
    np.testing.assert_array_equal(as_the_rig_has_it(truth, np.full_like(truth, np.nan)), truth)
