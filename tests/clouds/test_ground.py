"""The ground: found under what stands on it, not claimed where it is not, checked on KITTI."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.clouds.ground import Label, Remove
from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.geometry.cloud_frames import left_in
from pseudolidar.geometry.frames import R_BODY_OPTICAL, frame_tree
from pseudolidar.geometry.planes import Plane
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

HEIGHT_M = 1.7


def road(*, pitch_deg=0.0, roll_deg=0.0, seed=1, walls=True, noise_m=0.02, share=1.0):
    """A road as a LiDAR on a vehicle sees it, with walls and a car; and which points are road."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform((2, -10), (40, 10), (int(20_000 * share), 2))
    ground = np.column_stack([flat, np.full(len(flat), -HEIGHT_M)])
    ground[:, 2] += rng.normal(0, noise_m, len(ground))
    parts = [ground]
    if walls:
        side = rng.uniform((2, -HEIGHT_M), (40, 4), (12_000, 2))
        parts.append(np.column_stack([side[:, 0], np.full(len(side), 9.0), side[:, 1]]))
        car = rng.uniform((8, -2, -HEIGHT_M + 0.3), (12, 0, 0), (6000, 3))
        parts.append(car)
    xyz = np.concatenate(parts)
    a, b = np.radians([pitch_deg, roll_deg])
    pitch = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    roll = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    xyz = xyz @ (pitch @ roll).T
    is_road = np.arange(len(xyz)) < len(ground)
    return PointCloud(xyz.astype(np.float32), "velodyne"), is_road, pitch @ roll


@pytest.mark.parametrize(("pitch", "roll"), [(0, 0), (3, -2), (-6, 4)])
def test_the_road_is_found_among_walls(pitch, roll):
    cloud, is_road, R = road(pitch_deg=pitch, roll_deg=roll)
    plane, found = Label().load().found(cloud, ())
    assert plane is not None
    assert np.degrees(np.arccos(plane.normal @ R[:, 2])) < 0.15
    assert plane.offset_m == pytest.approx(HEIGHT_M, abs=0.02)
    assert found[is_road].mean() > 0.999
    assert found[~is_road].mean() < 0.06  # the feet of the walls


def test_labels_and_removal_are_of_the_same_points():
    cloud, _, _ = road()
    labelled, figures = Label().load()(cloud, ())
    removed, again = Remove().load()(cloud, ())
    on_ground = labelled.extra["ground"]
    assert on_ground.dtype == np.uint8
    assert figures == again
    assert figures["points_on_ground"] == on_ground.sum()
    assert len(removed) == len(cloud) - on_ground.sum()
    np.testing.assert_array_equal(removed.xyz, cloud.xyz[on_ground == 0])
    assert figures["ground_height_m"] == pytest.approx(HEIGHT_M, abs=0.02)
    assert figures["ground_tilt_deg"] < 0.2


def test_a_cloud_in_a_cameras_axes_is_turned():
    cloud, is_road, _ = road()
    T = Pose.from_rotation("velodyne", "camera_left", R_BODY_OPTICAL, np.zeros(3)).inverse()
    in_camera = cloud.transformed(T)
    for tree in ((), (T.inverse(),)):
        _, found = Label().load().found(in_camera, tree)
        assert found[is_road].mean() > 0.999


def test_results_repeat_and_nothing_is_changed():
    cloud, _, _ = road()
    before = cloud.xyz.copy()
    first, second = (Label().load().found(cloud, ())[0] for _ in range(2))
    assert first.offset_m == second.offset_m
    np.testing.assert_array_equal(first.normal, second.normal)
    np.testing.assert_array_equal(cloud.xyz, before)


@pytest.mark.parametrize("what", ["nothing", "a wall", "a few points", "a ramp too steep"])
def test_where_no_ground_is_seen_none_is_claimed(what):
    rng = np.random.default_rng(4)
    xyz = {
        "nothing": np.zeros((0, 3)),
        "a wall": rng.uniform((10, -9, -1.7), (10.1, 9, 4), (9000, 3)),
        "a few points": np.column_stack([rng.uniform(3, 4, (40, 2)), np.full(40, -1.7)]),
        "a ramp too steep": road(pitch_deg=25, walls=False)[0].xyz,
    }[what]
    cloud = PointCloud(xyz.astype(np.float32), "velodyne")
    labelled, figures = Label().load()(cloud, ())
    assert figures == {"points_on_ground": 0}
    assert not labelled.extra["ground"].any()
    assert len(Remove().load()(cloud, ())[0]) == len(cloud)


def test_a_known_height_decides_between_two_floors():
    """A bridge deck with more points than the road under it."""
    rng = np.random.default_rng(6)
    lower = np.column_stack([rng.uniform((2, -10), (30, 10), (9000, 2)), np.full(9000, -3.0)])
    upper = np.column_stack([rng.uniform((2, -10), (30, 10), (9000, 2)), np.full(9000, -1.7)])
    cloud = PointCloud(np.concatenate([lower, upper]).astype(np.float32), "velodyne")
    for height_m in (3.0, 1.7):
        fit = GroundFit(height_m=height_m, height_sigma_m=0.02)
        plane, _ = Label(fit).load().found(cloud, ())
        assert plane.offset_m == pytest.approx(height_m, abs=0.05)


def test_organised_clouds_keep_their_shape():
    cloud, _, _ = road()
    xyz = cloud.xyz.copy()
    xyz[::9] = np.nan
    organised = PointCloud(xyz, "velodyne", shape=(len(xyz) // 50, 50))
    removed, figures = Remove().load()(organised, ())
    assert removed.shape == organised.shape
    gone = np.count_nonzero(organised.valid) - np.count_nonzero(removed.valid)
    assert gone == figures["points_on_ground"]


def test_planes_in_other_frames_have_the_same_heights():
    rng = np.random.default_rng(9)
    plane = Plane.of("velodyne", np.array([0.1, -0.2, 2.0]), 3.4)
    T = Pose.from_rotation("camera_left", "velodyne", R_BODY_OPTICAL.T, np.array([1.0, 2, 3]))
    points = rng.normal(size=(50, 3))
    moved = plane.transformed(T)
    np.testing.assert_allclose(moved.heights_m(T.apply(points)), plane.heights_m(points))
    assert moved.frame == "camera_left"
    assert plane.heights_m(np.zeros((1, 3)))[0] == plane.offset_m


def test_the_road_of_a_street_is_the_ground():
    frame = Synthetic("street", frames=1, width_px=480).open().load(0)
    cloud = Reproject(max_range_m=40).load()(frame, frame.truth)
    plane, found = Label().load().found(cloud, frame_tree(frame.rig))
    camera = frame.rig.T_left_velodyne.inverse().apply(cloud.xyz)
    assert plane.tilt_deg(np.array([0.0, 0, 1])) < 1.5
    assert 1.4 < plane.offset_m < 2.1
    low = camera[:, 2] < -plane.offset_m + 0.1
    assert found[low].mean() > 0.9


@pytest.mark.real
def test_stereo_ground_is_velodynes_ground(real_data):
    """KITTI stereo 2015: median angle 0.2 degrees, height 1.73 m above the road to 1 cm."""
    source = KittiStereo(str(real_data / "kitti_stereo2015" / "training")).open()
    matcher, reproject, ground = Census().load(), Reproject().load(), Label().load()
    angles, heights, precision = [], [], []
    for index in range(0, 22, 3):
        frame = source.load(index)
        cloud = reproject(frame, matcher(frame)).transformed(left_in(frame.rig, "velodyne"))
        plane, found = ground.found(cloud, frame_tree(frame.rig))
        xyz = frame.scan.xyz
        ahead = (xyz[:, 0] > 0) & (np.abs(xyz[:, 1]) < 0.85 * xyz[:, 0])
        reference, _ = ground.found(PointCloud(np.ascontiguousarray(xyz[ahead]), "velodyne"), ())
        angles.append(np.degrees(np.arccos(min(1.0, plane.normal @ reference.normal))))
        heights.append((plane.offset_m, reference.offset_m))
        near = found & (cloud.xyz[:, 0] < 20)
        precision.append((np.abs(reference.heights_m(cloud.xyz[near])) < 0.3).mean())
    stereo, lidar = np.median(heights, axis=0)
    assert np.median(angles) < 0.4
    assert max(angles) < 2.0
    assert 1.6 < lidar < 1.8
    assert stereo == pytest.approx(lidar, abs=0.03)
    assert np.median(precision) > 0.97


@pytest.mark.real
def test_planes_jump_from_frame_to_frame_no_more_than_velodynes(real_data):
    """KITTI drive 0002: 0.12 and 0.19 degrees (roll, pitch) and 5 mm; Velodyne's 0.26, 0.23, 6."""
    source = KittiRaw(str(real_data / "kitti_raw" / "2011_09_26")).open()
    matcher, reproject, ground = Census().load(), Reproject().load(), Label().load()
    stereo, lidar = [], []
    for index in range(10):
        frame = source.load(index)
        cloud = reproject(frame, matcher(frame)).transformed(left_in(frame.rig, "velodyne"))
        xyz = frame.scan.xyz
        ahead = (xyz[:, 0] > 0) & (np.abs(xyz[:, 1]) < 0.85 * xyz[:, 0])
        scan = PointCloud(np.ascontiguousarray(xyz[ahead]), "velodyne")
        for found, seen, tree in ((stereo, cloud, frame_tree(frame.rig)), (lidar, scan, ())):
            plane, _ = ground.found(seen, tree)
            roll, pitch = np.degrees(np.arcsin(plane.normal[[1, 0]]))
            found.append((roll, pitch, plane.offset_m))
    ours, theirs = (np.median(np.abs(np.diff(x, axis=0)), axis=0) for x in (stereo, lidar))
    assert (ours[:2] < 1.3 * theirs[:2]).all()
    assert ours[2] < theirs[2] + 0.005
