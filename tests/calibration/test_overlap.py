"""Places of pairs from what they see in common: recovered, with an honest sigma, or refused."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.calibration.overlap import Overlap, Sight, Trust
from pseudolidar.calibration.overlap_fit import (
    PlaceFound,
    _Doubt,
    about_place,
    moved_by,
    places_found,
)
from pseudolidar.calibration.overlap_partners import Partners, all_partners, partners_of
from pseudolidar.calibration.overlap_trust import spread_of
from pseudolidar.errors import OverlapInsufficient
from pseudolidar.geometry.frames import BASE_LINK
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.body import BodyRig
from pseudolidar.structures.pose import Pose
from tests.body_rigs import MOUNTS, body_rig, exact_cloud, off_by, perturbed

FRAMES = 3


@functools.cache
def sights() -> tuple[dict[str, Sight], ...]:
    """What three pairs see of a rendered street, by its exact depths."""
    return tuple(
        {name: Sight.of(exact_cloud(frame, name), Overlap()) for name in MOUNTS}
        for frame in range(FRAMES)
    )


def places(body: BodyRig) -> dict[str, Pose]:
    return {pair.name: pair.T_base_link_left for pair in body.pairs}


def errors(found: dict[str, PlaceFound], name: str) -> tuple[float, float]:
    pair = body_rig()[name].placed(found[name].T_base_link_left)
    return off_by(BodyRig((pair,)), name)


@pytest.mark.parametrize(("turn_deg", "shift_m", "seed"), [(0, 0, 0), (2, 0.1, 1), (4, 0.3, 2)])
def test_perturbed_places_are_recovered(turn_deg: float, shift_m: float, seed: int) -> None:
    given = places(perturbed(body_rig(), turn_deg=turn_deg, shift_m=shift_m, seed=seed))
    found = places_found(
        sights(), given, "front", Overlap(), Trust(given_shift_m=1, given_turn_deg=10)
    )
    assert set(found) == {"left", "right"}
    for name, place in found.items():
        off_m, off_deg = errors(found, name)
        assert off_m < 0.02, name
        assert off_deg < 0.15, name
        # What it says of itself: neither too little nor ten times too much.
        assert off_m < 3 * np.linalg.norm(place.translation_sigma_m)
        assert place.translation_sigma_m.max() < 0.15
        assert np.degrees(np.linalg.norm(place.rotation_sigma_rad)) < 0.5
        # The road holds height, pitch and roll; along the street clouds slide.
        assert np.argsort(place.translation_sigma_m).tolist() == [2, 1, 0]
        assert np.argmax(place.rotation_sigma_rad) == 2
        assert place.moved_m == pytest.approx(shift_m, abs=0.02)
        assert place.turned_deg == pytest.approx(turn_deg, abs=0.15)
        assert place.matches > 1000
        assert place.after_m < 0.01
        assert place.before_m > place.after_m or not turn_deg


def test_another_root_gives_the_same_body() -> None:
    """Places relative to each other do not depend on which pair stays."""
    given = places(perturbed(body_rig(), turn_deg=1, shift_m=0.05, seed=3))
    by_front = places_found(sights(), given, "front", Overlap(), Trust())
    by_left = places_found(sights(), given, "left", Overlap(), Trust())
    one = given["front"].inverse().matrix @ by_front["right"].T_base_link_left.matrix
    front = by_left["front"].T_base_link_left
    other = front.inverse().matrix @ by_left["right"].T_base_link_left.matrix
    np.testing.assert_allclose(one, other, atol=0.02)


def test_open3d_finds_the_same() -> None:
    """One frame of two pairs, by the point-to-plane ICP of Open3D."""
    from pseudolidar.geometry.open3d_library import load_open3d

    o3d = load_open3d()
    pair = {name: sights()[1][name] for name in ("front", "left")}
    given = {name: pose for name, pose in places(body_rig()).items() if name in pair}
    loose = Trust(worst_shift_m=9, worst_turn_deg=90)
    ours = places_found([pair], given, "front", Overlap(), loose)["left"].T_base_link_left
    clouds = {}
    for name, sight in pair.items():
        clouds[name] = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(sight.xyz))
        clouds[name].normals = o3d.utility.Vector3dVector(sight.normals)
    start = given["front"].inverse().matrix @ given["left"].matrix
    method = o3d.pipelines.registration.TransformationEstimationPointToPlane()
    T_front_left = start
    for gate_m in Overlap().gates_m:
        T_front_left = o3d.pipelines.registration.registration_icp(
            clouds["left"], clouds["front"], gate_m, T_front_left, method
        ).transformation
    T = given["front"].matrix @ T_front_left
    np.testing.assert_allclose(ours.matrix, T, atol=0.03)


# --- what is refused -----------------------------------------------------------------------------


def plane(normal: np.ndarray, offset_m: float, seed: int = 0) -> Sight:
    """A wall as any camera sees it: points on a plane in front of it."""
    rng = np.random.default_rng(seed)
    rays = np.c_[rng.uniform(-0.9, 0.9, (4000, 2)), np.ones(4000)]
    t = offset_m / (rays @ normal)
    xyz = (rays * t[:, None])[(t > 0) & (t < 20)]
    return Sight(xyz, np.tile(-normal, (len(xyz), 1)), np.full(len(xyz), 0.02))


def test_a_single_plane_holds_nothing_along_itself() -> None:
    ground = np.array([0.0, 1.0, 0.0])
    seen = [{"a": plane(ground, 1.5, seed), "b": plane(ground, 1.5, seed + 9)} for seed in range(3)]
    given = {name: Pose(BASE_LINK, "camera_left", np.eye(4)) for name in ("a", "b")}
    with pytest.raises(OverlapInsufficient, match="b: known to") as error:
        places_found(seen, given, "a", Overlap(), Trust())
    assert error.value.where == "pair b"
    direction = error.value.got.split("along (")[1].split(")")[0]
    x, y, z = (abs(float(part)) for part in direction.split(","))
    assert y < 0.2 < max(x, z)


def test_pairs_that_share_nothing_are_refused_with_what_they_share() -> None:
    given = places(body_rig())
    away = given["left"].matrix.copy()
    away[:3, 3] += [0, 100, 0]
    given["left"] = Pose(BASE_LINK, "camera_left", away)
    with pytest.raises(OverlapInsufficient, match="left shares too little") as error:
        places_found(sights(), given, "front", Overlap(), Trust())
    assert "0 with front" in error.value.got


def test_a_place_far_from_the_given_one_is_not_believed() -> None:
    given = places(perturbed(body_rig(), turn_deg=2, shift_m=0.3, seed=5))
    sure = Trust(given_shift_m=0.01, given_turn_deg=0.1)
    with pytest.raises(OverlapInsufficient, match="from the place given") as error:
        places_found(sights(), given, "front", Overlap(), sure)
    assert "--trust.given-shift-m" in error.value.fix


def test_a_sight_is_near_sure_and_thin() -> None:
    cloud = exact_cloud(0, "front")
    sight = Sight.of(cloud, Overlap(most_m=10, most_sigma_m=0.2, voxel_m=0.5))
    assert 0 < len(sight) < len(cloud) / 20
    assert np.linalg.norm(sight.xyz, axis=1).max() < 10
    assert sight.sigma_m.max() < 0.2
    np.testing.assert_allclose(np.linalg.norm(sight.normals, axis=1), 1, atol=1e-5)
    assert ((sight.normals * sight.rays).sum(axis=1) < 0.1).all()
    assert len(Sight.of(cloud[:0], Overlap())) == 0


def test_surfaces_that_face_elsewhere_are_no_partners_and_far_ones_count_less() -> None:
    """Two pairs at one place see the same points; of half of them the other side."""
    xyz = np.array([[0.0, 0.0, 4.0], [1.0, 0.0, 4.0], [0.0, 1.0, 4.0], [1.0, 1.0, 4.0]])
    towards, along = np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0])
    first = Sight(xyz, np.array([towards] * 4), np.full(4, 0.03))
    off = xyz + np.array([0.0, 0.0, 0.1])
    second = Sight(off, np.array([towards, towards, along, -towards]), np.full(4, 0.04))
    place = Pose.identity("base_link", "camera_left")
    frame = {"a": first, "b": second}
    found = partners_of(frame, "a", "b", {"a": place, "b": place}, 0.5)
    np.testing.assert_allclose(found.points, xyz[:2])
    np.testing.assert_allclose(found.residual_m, 0.1)
    near = replace(found, residual_m=np.zeros(2))
    scaled = 0.1 / (2.0 * found.sigma_m)
    np.testing.assert_allclose(found.weights, near.weights / (1 + scaled**2))
    np.testing.assert_allclose(near.weights, 1 / found.sigma_m**2)


def test_points_that_are_off_by_more_than_is_usual_count_for_little() -> None:
    """Also where their own standard deviation, with all that a rig errs by, would allow it."""
    across = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), -1).reshape(-1, 2)
    xyz = np.c_[across - 2.0, np.full(25, 4.0)]
    normals = np.tile([0.0, 0.0, -1.0], (25, 1))
    off = xyz + np.array([0.0, 0.0, 0.002])
    off[7, 2] += 0.1
    frame = {name: Sight(at, normals, np.full(25, 0.5)) for name, at in (("a", xyz), ("b", off))}
    place = Pose.identity("base_link", "camera_left")
    first, second = all_partners([frame], {"a": place, "b": place}, 0.5)
    assert first.usual == second.usual == 0.05
    like_others = replace(first, residual_m=np.zeros(25)).weights
    assert first.weights[7] < 0.5 * like_others[7]
    assert first.weights[8] > 0.99 * like_others[8]


def test_one_frame_tells_its_spread_by_slices_of_what_is_shared() -> None:
    """Walls that bulge pull the slices apart, which no covariance of single points knows."""
    given, gate_m = places(body_rig()), Overlap().gates_m[-1]
    as_is = {name: sights()[1][name] for name in ("front", "left")}
    x, _, z = as_is["left"].xyz.T
    bulge = 1.0 + 0.01 * np.sin(8 * np.arctan2(x, z))
    bulging = as_is | {"left": replace(as_is["left"], xyz=as_is["left"].xyz * bulge[:, None])}
    calm, torn = (spread_of([frame], given, ["left"], gate_m) for frame in (as_is, bulging))
    assert (calm > 0).all()
    assert (torn > 2 * calm).all()


def test_slices_hold_each_point_once_with_all_its_rows_side_by_side() -> None:
    angles = np.radians([170.0, -60.0, 10.0, -100.0, 80.0])
    points = np.c_[np.cos(angles), np.sin(angles), np.zeros(5)]
    rows = np.arange(15.0)
    board = Partners(
        "a", "b", np.repeat(points, 3, axis=0), np.tile(np.eye(3), (5, 1)), rows, rows, rows, 0.1, 3
    )
    slices = board.slices(2)
    assert [part.count for part in slices] == [3, 2]
    assert [part.residual_m[::3].tolist() for part in slices] == [[9, 3, 6], [12, 0]]
    assert slices[1].residual_m.tolist() == [12, 13, 14, 0, 1, 2]


def test_a_turn_about_the_body_moves_a_pair_that_stands_far_from_its_origin() -> None:
    """Shift and turn of a place by a twist of the body are what the poses before and after say."""
    matrix = body_rig()["left"].T_base_link_left.matrix.copy()
    matrix[:3, 3] = 2.0, -3.0, 1.0
    place = Pose(BASE_LINK, "camera_left", matrix)
    twist = 1e-4 * np.array([1.0, -2.0, 3.0, 4.0, 5.0, -6.0])
    after = Pose(BASE_LINK, "camera_left", exp_twist(twist) @ matrix)
    seen = np.concatenate(moved_by(place, after))
    np.testing.assert_allclose(about_place(place) @ twist, seen, rtol=0, atol=5e-6)
    # What points tell of the twist and what slices of them spread by are two errors.
    told = _Doubt.of(place, np.diag(np.full(6, 9.0)), np.full(6, 4.0), slice(0, 6))
    np.testing.assert_allclose(told.sigma[3:], 5.0)
