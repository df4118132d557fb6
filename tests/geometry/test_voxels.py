import numpy as np
import pytest

from pseudolidar.geometry.voxels import best_of_voxel


def oracle(xyz, sigma_m, voxel_m):
    """Plain numpy: sort by cube, then sigma, then order, and take the first of each cube."""
    finite = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    sigma_m = np.zeros(len(xyz)) if sigma_m is None else sigma_m
    cells = np.floor(xyz[finite].astype(float) / voxel_m).astype(np.int64)
    order = np.lexsort((finite, sigma_m[finite], *cells.T))
    first = np.r_[True, np.any(np.diff(cells[order], axis=0) != 0, axis=1)]
    return np.sort(finite[order[first]])


@pytest.mark.parametrize("voxel_m", [0.2, 1.0, 50.0])
@pytest.mark.parametrize("with_sigma", [True, False])
def test_same_points_as_plain_numpy(voxel_m, with_sigma):
    rng = np.random.default_rng(6)
    xyz = rng.normal(0, 5, (5000, 3)).astype(np.float32)
    xyz[::17] = np.nan
    sigma_m = rng.integers(1, 9, len(xyz)).astype(np.float32) if with_sigma else None
    kept = best_of_voxel(xyz, sigma_m, voxel_m=voxel_m)
    np.testing.assert_array_equal(kept, oracle(xyz, sigma_m, voxel_m))


def test_no_points():
    assert len(best_of_voxel(np.zeros((0, 3), np.float32), None, voxel_m=0.1)) == 0


def test_a_point_of_unknown_sigma_gives_way():
    xyz = np.zeros((4, 3), np.float32)
    for sigma_m, best in (([np.nan, 2, 1, np.nan], 2), ([np.nan] * 4, 0), ([3, np.nan, 4, 5], 0)):
        kept = best_of_voxel(xyz, np.array(sigma_m, np.float32), voxel_m=1)
        assert kept.tolist() == [best]
