"""Points that have others around them, against scipy's KD-tree."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pseudolidar.geometry.crowding_kernels import crowded


def wanted(xyz, radius_m, neighbours):
    finite = np.isfinite(xyz).all(axis=1)
    tree = cKDTree(xyz[finite])
    found = np.zeros(len(xyz), bool)
    counts = tree.query_ball_point(xyz[finite], radius_m[finite], return_length=True)
    found[finite] = counts - 1 >= neighbours
    return found


@pytest.mark.parametrize("neighbours", [1, 4, 12])
@pytest.mark.parametrize("seed", range(4))
def test_the_same_points_as_a_tree_finds(seed, neighbours):
    rng = np.random.default_rng(seed)
    clumps = rng.normal(0, 20, (60, 3))
    xyz = clumps[rng.integers(0, 60, 4000)] + rng.normal(0, 0.5, (4000, 3))
    xyz[::97] = np.nan
    xyz[5] = xyz[6]  # one on the other
    radius_m = np.exp(rng.uniform(np.log(0.02), np.log(3.0), 4000))
    found = crowded(xyz, radius_m, neighbours=neighbours)
    assert np.array_equal(found, wanted(xyz, radius_m, neighbours))
    assert 0.05 < found.mean() < 0.99


def test_single_precision_clouds_and_points_on_the_border_of_the_ball():
    xyz = np.array([[0, 0, 0], [1, 0, 0], [-5, 0, 0]], np.float32)
    for radius, found in ((1.0, [True, True, False]), (0.999, [False] * 3)):
        assert crowded(xyz, np.full(3, radius), neighbours=1).tolist() == found


def test_nothing_is_crowded_in_clouds_without_points():
    assert len(crowded(np.empty((0, 3)), np.empty(0), neighbours=1)) == 0
    assert not crowded(np.full((5, 3), np.nan), np.ones(5), neighbours=1).any()
