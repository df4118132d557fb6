"""Octrees of large clouds: what is in them, and what a view needs of them."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.octree.chosen import Eye, along, chosen, needs_px, point_sizes_m, within
from pseudolidar.viewer.octree.tree import Octree
from pseudolidar.viewer.picking import picked
from tests.viewer.octree.street import COUNT, UTM_M, street


@pytest.fixture(scope="module")
def tree() -> Octree:
    return built(street())


def eye(*, height_m: float, aside_m: float = 0.0) -> Eye:
    """Looks straight down."""
    found = Eye.of(
        wxyz=np.array([0.0, 1.0, 0.0, 0.0]),
        position_m=np.array([aside_m, 0.0, height_m]),
        fov=1.0,
        width_px=1200,
        height_px=800,
        T_map_scene=np.block([[np.eye(3), UTM_M[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]),
    )
    assert found is not None
    return found


def test_places_and_columns_are_those_of_the_cloud(tree: Octree):
    cloud, found = street(), tree.cloud(range(len(tree.nodes)))
    rows = found.extra["time_s"].astype(int)
    assert np.array_equal(np.sort(rows), np.arange(COUNT))
    assert np.abs(found.xyz - cloud.xyz[rows]).max() < 1e-5
    assert found.rgb is not None
    assert cloud.rgb is not None
    assert np.array_equal(found.rgb, cloud.rgb[rows])
    assert np.array_equal(found.sigma_m, cloud.sigma_m[rows])
    assert "nx" not in found.extra


def test_what_is_sent_is_exact_to_half_a_millimetre_on_earth(tree: Octree):
    cloud = street()
    for number in range(len(tree.nodes)):
        rows = tree.cloud([number]).extra["time_s"].astype(int)
        small = tree.half_m[number] <= 2.0
        sent = tree.spread_m(number).astype(np.float16 if small else np.float32)
        # Browsers add positions of nodes, relative to the middle of the map, in float32.
        node = (tree.middles_m[number] - UTM_M).astype(np.float32)
        drawn = node.astype(np.float64) + sent.astype(np.float64) + UTM_M
        assert np.abs(drawn - cloud.xyz[rows]).max() < 1e-3


def test_boxes_hold_what_is_in_nodes_and_below_them(tree: Octree):
    middles, halves = tree.boxes_m
    xyz = street().xyz
    assert np.allclose(middles[0] + halves[0], xyz.max(axis=0), atol=1e-4)
    assert np.allclose(middles[0] - halves[0], xyz.min(axis=0), atol=1e-4)
    assert (halves[:, 2] < 0.11).all()  # a street is flat, whatever cubes it lies in


def test_nodes_know_what_they_are_part_of(tree: Octree):
    parents = tree.parents
    assert (parents[tree.nodes["level"] == 0] == -1).all()
    inner = np.flatnonzero(parents >= 0)
    assert len(inner) == len(tree.nodes) - 1
    away = np.abs(tree.middles_m[inner] - tree.middles_m[parents[inner]])
    assert (away <= tree.half_m[parents[inner], None]).all()


def test_coarse_nodes_come_before_what_lies_in_them(tree: Octree):
    for height_m in (2.0, 15.0, 300.0):
        needs = needs_px(tree, eye(height_m=height_m))
        inner = tree.parents >= 0
        assert (needs[inner] <= needs[tree.parents[inner]]).all()


def test_near_views_are_fine_and_far_ones_coarse(tree: Octree):
    counts = tree.nodes["count"]
    near, far = (chosen(needs_px(tree, eye(height_m=h)), counts, COUNT) for h in (5.0, 20_000.0))
    assert tree.nodes["level"][near].max() == tree.nodes["level"].max()
    assert len(far) == 0
    # Above a corner only what is near it is drawn finely.
    corner = chosen(needs_px(tree, eye(height_m=5.0, aside_m=38.0)), counts, COUNT)
    fine = corner[tree.nodes["level"][corner] == tree.nodes["level"].max()]
    assert len(fine)
    assert (tree.boxes_m[0][fine][:, 0] > UTM_M[0]).all()


@pytest.mark.parametrize("budget", [0, 30_000, 70_000])
def test_the_budget_is_kept(tree: Octree, budget: int):
    needs = needs_px(tree, eye(height_m=20.0))
    drawn = chosen(needs, tree.nodes["count"], budget)
    assert tree.nodes["count"][drawn].sum() <= budget


def test_nodes_that_the_eye_is_in_are_needed_equally(tree: Octree):
    inside = Eye(UTM_M + np.array([20.0, 13.0, 0.05]), np.diag([1.0, -1.0, -1.0]), 1.0, 1.5, 800)
    middles, halves = tree.boxes_m
    holding = (np.abs(inside.position_m - middles) < halves).all(axis=1)
    assert holding.sum() > 1
    # As if their points were a quarter of half an edge away.
    away_m = 0.25 * tree.half_m[holding]
    apart_m = 2 * tree.cube.spacing_m(tree.nodes["level"][holding])
    assert np.allclose(needs_px(tree, inside)[holding], apart_m * inside.focal_px / away_m)


def test_nodes_behind_the_eye_are_left_out(tree: Octree):
    up = Eye(UTM_M + np.array([0, 0, 5.0]), np.eye(3), 1.0, 1.5, 800)
    assert not within(tree, up.sides()).any()
    assert within(tree, eye(height_m=5.0).sides()).any()


def test_points_are_as_large_as_gaps_between_them(tree: Octree):
    every = np.arange(len(tree.nodes))
    alone, together = point_sizes_m(tree, every[:1]), point_sizes_m(tree, every)
    assert alone[0] == pytest.approx(tree.cube.spacing_m(tree.nodes["level"][:1])[0])
    assert together[0] < alone[0]
    between_m = 80 / np.sqrt(COUNT)
    assert np.median(together) == pytest.approx(between_m, rel=0.5)


def test_a_click_finds_the_point_that_all_points_would_give(tree: Octree):
    every = tree.cloud(range(len(tree.nodes)))
    rng = np.random.default_rng(1)
    for _ in range(25):
        origin = UTM_M + rng.uniform((-60, -60, 0.05), (60, 60, 9))
        direction = every.xyz[rng.integers(COUNT)] - origin
        numbers = along(tree, origin, direction)
        want = picked({"all": (every, np.eye(4))}, origin, direction)
        found = picked({"some": (tree.cloud(numbers.tolist()), np.eye(4))}, origin, direction)
        assert want is not None
        assert found is not None
        assert np.array_equal(found.xyz_m, want.xyz_m)


def test_stray_points_are_clicked_and_seen_too():
    cloud = street(30_000)
    xyz = cloud.xyz.copy()
    xyz[17] = 0  # 5 400 km away
    tree = built(PointCloud(xyz, "map"))
    assert (np.abs(tree.places).max(axis=1) > 1000).sum() == 1
    origin, direction = np.array([0.0, 0.0, 50.0]), np.array([0.0, 0.0, -1.0])
    numbers = along(tree, origin, direction)
    found = picked({"some": (tree.cloud(numbers.tolist()), np.eye(4))}, origin, direction)
    assert found is not None
    assert np.abs(found.xyz_m).max() < 1
    above = Eye(origin, np.diag([1.0, -1.0, -1.0]), 1.0, 1.5, 800)
    holds = [
        number for number in range(len(tree.nodes)) if np.abs(tree.spread_m(number)).max() > 1000
    ]
    assert within(tree, above.sides())[holds].all()


def test_a_click_looks_through_few_nodes(tree: Octree):
    corner = UTM_M + np.array([35.0, 35.0, 8.0])
    # The root, and the two nodes that share the corner: the cube's middle is within the street.
    assert along(tree, corner, np.array([0.0, 0.0, -1.0])).tolist() == [0, 7, 8]
    assert along(tree, corner, np.array([0.0, 0.0, 1.0])).tolist() == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"wxyz": np.zeros(4)},
        {"fov": float("nan")},
        {"height_px": 0},
        {"width_px": -4},
        {"position_m": np.array([np.inf, 0, 0])},
    ],
)
def test_cameras_that_are_none_see_nothing(wrong: dict):
    said = {
        "wxyz": np.array([1.0, 0, 0, 0]),
        "position_m": np.zeros(3),
        "fov": 1.0,
        "width_px": 100,
        "height_px": 100,
    }
    assert Eye.of(**{**said, **wrong}, T_map_scene=np.eye(4)) is None
