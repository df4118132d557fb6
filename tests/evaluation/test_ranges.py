import numpy as np
import pytest

from pseudolidar.evaluation.ranges import RANGE_BINS_M, errors_by_range


def test_bins_are_on_the_reference_and_empty_ones_have_no_figures():
    reference_m = np.array([5.0, 6.0, 10.0, 60.0, 100.0, 2.0, 7.0])
    depth_m = np.array([5.5, 5.4, 11.0, 90.0, 100.0, 2.0, np.nan])
    near, middle, far, farther, farthest = errors_by_range(depth_m, reference_m)
    assert [(b.from_m, b.to_m) for b in (near, middle, far)] == list(RANGE_BINS_M[:3])
    assert (near.n, middle.n, far.n, farther.n, farthest.n) == (2, 1, 0, 0, 1)
    assert near.median_rel == pytest.approx(0.1)
    assert near.bias_rel == pytest.approx(0.0, abs=1e-12)
    assert farthest.bias_rel == pytest.approx(0.5)
    assert (far.median_rel, far.p90_rel, far.bias_rel) == (None, None, None)


def test_percentile_and_sign():
    reference_m = np.full(101, 25.0)
    depth_m = reference_m * (1 - np.linspace(0, 0.1, 101))
    (bin_,) = [b for b in errors_by_range(depth_m, reference_m) if b.n]
    assert bin_.median_rel == pytest.approx(0.05)
    assert bin_.p90_rel == pytest.approx(0.09)
    assert bin_.bias_rel == pytest.approx(-0.05)
