"""Points in the order of an octree."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.octree import MOST_IN_NODE, OctreeOrder, octree_order


def plane(count: int, dtype: type = np.float32) -> np.ndarray:
    rng = np.random.default_rng(1)
    xyz = rng.uniform((-20, -20, 0), (20, 20, 0.01), (count, 3))
    return xyz.astype(dtype)


def numbers(found: OctreeOrder) -> np.ndarray:
    """(N,) the node of each point, in the order of the octree."""
    return np.repeat(np.arange(len(found.nodes)), found.nodes["count"])


def test_every_finite_point_is_in_one_node():
    xyz = plane(90_000)
    xyz[::1000] = (np.nan, 0, 0)
    xyz[1::1000] = (0, np.inf, 0)
    found = octree_order(xyz)
    assert np.array_equal(np.sort(found.order), np.flatnonzero(np.isfinite(xyz).all(axis=1)))
    assert found.nodes["start"][0] == 0
    assert np.array_equal(
        found.nodes["start"][1:], np.cumsum(found.nodes["count"])[:-1].astype(np.int64)
    )
    assert (np.diff(found.nodes["level"].astype(int)) >= 0).all()


def test_points_lie_in_the_cubes_of_their_nodes():
    xyz = plane(90_000)
    found = octree_order(xyz)
    off = xyz[found.order] - found.cube.middles_m(found.nodes)[numbers(found)]
    half = found.cube.half_m(found.nodes["level"])[numbers(found)]
    assert (np.abs(off) <= half[:, None] * (1 + 1e-4)).all()
    assert found.nodes["level"].max() >= 1


def test_points_of_a_level_keep_their_distance():
    # One point a cell: neighbours of a level are in different cells, and each cell has one.
    xyz = plane(200_000)
    found = octree_order(xyz)
    coarse = xyz[found.order[: int(found.nodes["count"][found.nodes["level"] == 0].sum())]]
    spacing_m = found.cube.spacing_m(np.zeros(1, np.uint8))[0]
    cells = np.floor((coarse - found.cube.low_m) / spacing_m).astype(int)
    assert len(np.unique(cells, axis=0)) == len(coarse)
    every = np.floor((xyz - found.cube.low_m) / spacing_m).astype(int)
    assert len(np.unique(every, axis=0)) == len(coarse)


def test_small_clouds_are_one_node():
    found = octree_order(plane(MOST_IN_NODE))
    assert len(found.nodes) == 1
    assert found.nodes["count"][0] == MOST_IN_NODE


@pytest.mark.parametrize("count", [0, 1, 60_000])
def test_points_at_one_place(count: int):
    found = octree_order(np.full((count, 3), 7.5))
    assert len(found.order) == count
    assert found.nodes["count"].sum() == count
    assert (found.cube.half_m(found.nodes["level"]) > 0).all()


def test_the_order_does_not_change_from_run_to_run():
    xyz = plane(50_000, np.float64)
    first, second = octree_order(xyz), octree_order(xyz.copy())
    assert np.array_equal(first.order, second.order)


@pytest.mark.parametrize("stray_m", [-1e4, 0.0, 1e9, 1e300])
def test_a_stray_point_makes_no_giant_node_of_the_others(stray_m: float):
    xyz = np.array([4.5e5, 5.4e6, 110.0]) + plane(300_000, np.float64)
    without = octree_order(xyz)
    xyz[70_000] = stray_m
    found = octree_order(xyz)
    assert found.nodes["count"].max() <= 2 * MOST_IN_NODE
    assert found.cube.size_m == pytest.approx(without.cube.size_m, abs=1e-3)
    assert len(found.nodes) == pytest.approx(len(without.nodes), abs=1)
    assert np.array_equal(np.sort(found.order), np.arange(len(xyz)))
    # It is at the border that it lies beyond.
    at = np.flatnonzero(found.order == 70_000)[0]
    node = found.nodes[np.searchsorted(found.nodes["start"], at, side="right") - 1]
    above = np.sign(stray_m - xyz[0]) > 0
    assert np.array_equal(node["cell"], np.where(above, 2 ** int(node["level"]) - 1, 0))
