from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.matching_loss import (
    GAP_COST,
    as_the_rig_has_it,
    judged_by_reference,
)

ROWS = np.ones(40, bool)


def reference():
    rng = np.random.default_rng(0)
    values = rng.uniform(5, 60, (40, 60)).astype(np.float32)
    values[:, :10] = np.nan
    return values


def test_errors_cost_in_proportion_up_to_three_pixels_and_gaps_a_fifth():
    truth = reference()
    assert judged_by_reference(truth, truth, ROWS).loss == 0.0
    assert judged_by_reference(truth + 1.5, truth, ROWS).loss == pytest.approx(0.5, abs=1e-6)
    assert judged_by_reference(truth + 40, truth, ROWS).loss == 1.0
    half = truth.copy()
    half[:, 35:] = np.nan
    found = judged_by_reference(half, truth, ROWS)
    assert (found.loss, found.density) == (pytest.approx(GAP_COST / 2), 0.5)
    assert found.d1_est == 0.0


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
