import pytest

from pseudolidar.evaluation.compared import against_scan
from pseudolidar.evaluation.comparison.bins import DEFAULT_BINS
from pseudolidar.evaluation.comparison.comparison import compare_frames
from pseudolidar.evaluation.comparison.pooled import PointPool
from tests.evaluation.test_lidar import frame, wall


def test_points_of_all_are_counted_and_thinned_alike():
    one = compare_frames([against_scan(wall(), frame())])
    n = one.overall.n
    whole, thinned = (PointPool(DEFAULT_BINS, most=most) for most in (3 * n, 3 * n - 1))
    for pool in (whole, thinned):
        for _ in range(3):
            pool.add(one)
    every = whole.figures()
    assert (every.frames, every.overall.n) == (3, 3 * n)
    assert every.by_range[0].figures.median_rel == pytest.approx(0.25)
    assert every.as_dict()["bins"][0]["n"] == 3 * n
    assert thinned.figures().overall.n == 3 * ((n + 1) // 2)
