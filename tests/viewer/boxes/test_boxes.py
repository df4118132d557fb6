"""Boxes in the scene, and what their points tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.boxes.figures import BoxFigures, Found
from pseudolidar.viewer.boxes.region import LEAST_M, MARGIN_M, MOST_M, Region
from pseudolidar.viewer.boxes.told import NONE, table

NOISE, SIGMA = 0.015, 0.05
HERE = np.array([8.0, -2.0, 1.0])


def wall(turn_deg: float = 0.0, at_m: np.ndarray = HERE, count: int = 6000) -> PointCloud:
    """2 m wide, 1 m high, upright, its normal along x before it is turned about the vertical."""
    rng = np.random.default_rng(0)
    flat = rng.uniform((0, -1, -0.5), (0, 1, 0.5), (count, 3))
    flat[:, 0] = rng.normal(0, NOISE, count)
    turn = Region.about(np.zeros(3), np.ones(3)).turned(turn_deg).T_local_box[:3, :3]
    sigma_m = np.full(count, SIGMA, np.float32)
    return PointCloud(flat @ turn.T + at_m, "map", sigma_m=sigma_m)


def figures(region: Region, cloud: PointCloud, **known: object) -> BoxFigures:
    found = BoxFigures.of(region, Found(cloud, np.eye(4), **known))  # type: ignore[arg-type]
    assert found is not None
    return found


def test_a_wall_is_told_as_it_is():
    cloud = wall(30)
    told = figures(Region.about(HERE, np.full(3, 3.0)), cloud)
    assert len(told.points) == len(cloud)
    assert told.middle_m == pytest.approx(HERE, abs=0.03)
    assert told.own_m == pytest.approx((2, 1, 2 * 3.9 * NOISE), rel=0.2, abs=0.03)
    cosine, sine = np.cos(np.pi / 6), np.sin(np.pi / 6)
    assert told.along_m == pytest.approx((2 * sine + 0.05, 2 * cosine + 0.05, 1), abs=0.1)
    flat = told.flatness
    assert flat is not None
    assert flat.tilt_deg == pytest.approx(90, abs=0.1)
    assert np.abs(flat.normal) == pytest.approx((cosine, sine, 0), abs=2e-3)
    assert flat.rms_m == pytest.approx(NOISE, rel=0.03)
    assert flat.most_m == pytest.approx(1.96 * NOISE, rel=0.04)
    assert flat.expected_m == pytest.approx(SIGMA)
    assert not flat.seen
    assert flat.per_m2 == pytest.approx(6000 / 2, rel=0.03)


def test_sigma_across_a_plane_is_what_its_rays_leave_of_it():
    """Seen at 60 degrees from its normal half of sigma is across."""
    far = HERE + 1000 * np.array([-np.cos(np.pi / 3), np.sin(np.pi / 3), 0])
    flat = figures(Region.about(HERE, np.full(3, 3.0)), wall(), eye_m=far).flatness
    assert flat is not None
    assert flat.seen
    assert flat.expected_m == pytest.approx(0.5 * SIGMA, rel=1e-3)
    assert flat.normal[0] < -0.99  # towards the eye
    behind = figures(Region.about(HERE, np.full(3, 3.0)), wall(), eye_m=2 * HERE - far).flatness
    assert behind is not None
    assert behind.normal[0] > 0.99


def test_points_without_a_sigma_say_nothing_of_it():
    cloud = wall()
    assert cloud.sigma_m is not None
    some = cloud.sigma_m.copy()
    some[:3] = np.inf, np.nan, -np.inf
    region = Region.about(HERE, np.full(3, 3.0))
    flat = figures(region, replace(cloud, sigma_m=some)).flatness
    assert flat is not None
    assert flat.expected_m == pytest.approx(SIGMA)
    flat = figures(region, replace(cloud, sigma_m=np.full_like(some, np.inf))).flatness
    assert flat is not None
    assert flat.expected_m is None


def test_a_slanted_ground_looks_up():
    xyz = np.stack(np.meshgrid(np.linspace(0, 2, 30), np.linspace(0, 2, 30), [0.0]), -1)
    xyz = xyz.reshape(-1, 3)
    xyz[:, 2] = -xyz[:, 0] * np.tan(np.radians(10))
    flat = figures(Region.about(np.array([1.0, 1, 0]), np.full(3, 4.0)), PointCloud(xyz, "map"))
    assert flat.flatness is not None
    assert flat.flatness.tilt_deg == pytest.approx(10)
    assert flat.flatness.normal[2] > 0
    assert flat.flatness.rms_m < 1e-9
    assert flat.flatness.expected_m is None


def test_only_what_is_in_the_box_counts_and_keeps_its_columns():
    cloud = wall(0)
    numbered = replace(cloud, extra={"number": np.arange(len(cloud))})
    region = Region.about(np.add(HERE, (0, 0.5, 0)), np.array([1.0, 1.0, 0.5]))
    told = figures(region, numbered)
    inside = (cloud.xyz[:, 1] >= HERE[1]) & (np.abs(cloud.xyz[:, 2] - HERE[2]) <= 0.25)
    assert told.points.extra["number"].tolist() == np.flatnonzero(inside).tolist()
    assert told.points.sigma_m is not None


def test_turned_boxes_and_clouds_elsewhere():
    cloud = wall(40)
    region = Region.about(HERE, np.array([0.2, 3.0, 3.0]))
    assert len(figures(region, cloud).points) < 1000
    turned = region.turned(40)
    assert turned.turn_deg == pytest.approx(40)
    assert len(figures(turned, cloud).points) == len(cloud)
    T = np.eye(4)
    T[:3, 3] = (100, 50, -3)
    moved = replace(cloud, xyz=cloud.xyz - T[:3, 3])
    found = BoxFigures.of(turned, Found(moved, T))
    assert found is not None
    assert len(found.points) == len(cloud)
    assert found.middle_m == pytest.approx(HERE - T[:3, 3], abs=0.03)  # in its own frame
    assert found.flatness is not None
    assert found.flatness.middle_m == pytest.approx(HERE, abs=0.03)


def test_a_box_turns_to_a_plane_by_the_least_angle():
    region = Region.about(HERE, np.array([1.0, 2.0, 3.0])).turned(25)
    normal = np.array([np.cos(0.6), np.sin(0.6), 0.1])
    normal /= np.linalg.norm(normal)
    for towards in (normal, -normal, region.T_local_box[:3, 1], -region.T_local_box[:3, 0]):
        R = region.along(towards).T_local_box[:3, :3]
        assert np.abs(R.T @ towards).max() == pytest.approx(1)
        assert np.allclose(R.T @ R, np.eye(3))
        assert np.linalg.det(R) == pytest.approx(1)
        assert np.trace(R.T @ region.T_local_box[:3, :3]) > 2.8


def test_sides_say_what_holds_says():
    region = Region.about(HERE, np.array([1.0, 2.0, 3.0])).turned(25)
    T = Region.about(np.array([3.0, 1, 2]), np.ones(3)).turned(70).T_local_box
    xyz = np.random.default_rng(0).uniform(-12, 12, (20000, 3))
    normals, offsets = region.sides(T)
    inside = region.holds(region.places(xyz, T))
    assert 0 < inside.sum() < 200
    assert np.array_equal((xyz @ normals.T + offsets >= 0).all(axis=1), inside)


def test_two_corners_have_room_about_them_and_sizes_have_ends():
    region = Region.between(np.array([1.0, 5, 0]), np.array([3.0, 1, 0]))
    assert region.T_local_box[:3, 3] == pytest.approx((2, 3, 0))
    assert region.size_m == pytest.approx(np.array([2, 4, 0]) + 2 * MARGIN_M)
    assert region.sized(np.array([0, 1e9, 1])).size_m.tolist() == [LEAST_M, MOST_M, 1]
    edges = region.edges()
    assert edges.shape == (12, 2, 3)
    assert np.ptp(edges.reshape(-1, 3), axis=0) == pytest.approx(region.size_m)
    lengths = np.abs(edges[:, 0] - edges[:, 1])
    assert (np.count_nonzero(lengths > 1e-12, axis=1) == 1).all()


@pytest.mark.parametrize("count", [1, 2, 9])
def test_few_points_tell_their_place_and_no_plane(count: int):
    line = HERE + np.linspace(0, 0.5, count)[:, None] * (1, 1, 0)
    told = figures(Region.about(HERE, np.full(3, 2.0)), PointCloud(line, "map"))
    assert told.flatness is None
    assert told.own_m == pytest.approx((0.5 * 2**0.5 * (count > 1), 0, 0), abs=1e-9)
    shown = table({"<b>": told})
    assert f">{count}<" in shown
    assert "&lt;b&gt;" in shown
    assert "plane" not in shown


def test_a_box_without_points_says_so():
    region = Region.about(HERE + 50, np.ones(3))
    assert BoxFigures.of(region, Found(wall(), np.eye(4))) is None
    assert BoxFigures.of(region, Found(wall(count=0), np.eye(4))) is None
    assert NONE in table({})


def test_the_table_says_what_a_person_asks():
    told = figures(Region.about(HERE, np.full(3, 3.0)), wall(), eye_m=np.zeros(3))
    assert told.flatness is not None
    shown = table({"stereo": told})
    rms = f"{1000 * told.flatness.rms_m:.1f} mm"
    for words in ("6,000", "upright, 0.", rms, "flat within that", "per m²"):
        assert words in shown, words
    rough = wall()
    rough = replace(rough, sigma_m=np.full(len(rough), 0.001, np.float32))
    shown = table({"a": figures(Region.about(HERE, np.full(3, 3.0)), rough, whole=90_000_000)})
    assert "at most 1.0 mm: more uneven than that" in shown
    assert "of some 90,000,000 near it" in shown
