"""KISS-ICP on scans: a made-up yard that is driven through, bad scans, and KITTI's Velodyne."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import SequenceTime, UsageError
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import exp_twist, inverted
from pseudolidar.mapping.scan_odometry import ScanOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.structures.frame import LidarScan

STEP = exp_twist(np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.02]))
DT_NS = 100_000_000


def yard(poses):
    """Scans of ground and boxes from the given poses."""
    rng = np.random.default_rng(3)
    ground = np.column_stack([rng.uniform(-40, 40, (12000, 2)), np.full(12000, -1.7)])
    boxes = []
    for centre in rng.uniform(-35, 35, (60, 2)):
        face = rng.uniform(-1.5, 1.5, (150, 3))
        axis = rng.integers(0, 2, 150)
        face[np.arange(150), axis] = np.where(rng.random(150) < 0.5, -1.5, 1.5)
        boxes.append(face + np.array([*centre, 0.0]))
    world = np.concatenate([ground, *boxes])
    scans = []
    for T in poses:
        seen = (world - T[:3, 3]) @ T[:3, :3] + rng.normal(0, 0.01, world.shape)
        scans.append(LidarScan(seen.astype(np.float32)))
    return scans


@pytest.fixture(scope="module")
def drive():
    poses = [np.eye(4)]
    for _ in range(5):
        poses.append(poses[-1] @ STEP)
    return yard(poses), poses


def test_a_yard_is_driven(drive):
    scans, poses = drive
    chain = ScanOdometry().start()
    states = [chain.register(scan, i * DT_NS) for i, scan in enumerate(scans)]
    assert [state.status for state in states] == ["first"] + ["ok"] * 5
    assert np.linalg.norm(states[-1].T_odom_camera.matrix[:3, 3] - poses[-1][:3, 3]) < 0.05
    assert states[-1].T_odom_camera.src == "velodyne"
    assert 0 < states[-1].covariance[0, 0] < 0.1


def test_bad_scans_are_lost_counted_and_bridged(drive):
    scans, poses = drive
    few = LidarScan(scans[2].xyz[:3].copy())
    bad = LidarScan(np.full((50, 3), np.nan, np.float32))
    elsewhere = LidarScan(np.random.default_rng(0).uniform(-30, 30, (5000, 3)).astype(np.float32))
    chain = ScanOdometry().start()
    fed = [scans[0], scans[1], few, bad, elsewhere, scans[5]]
    states = [chain.register(scan, i * DT_NS) for i, scan in enumerate(fed)]
    assert [state.status for state in states] == ["first", "ok", "lost", "lost", "lost", "ok"]
    assert all(state.T_odom_camera is None and state.why for state in states[2:5])
    assert (chain.counts.few, chain.counts.empty, chain.counts.unplaced) == (1, 1, 1)
    assert chain.counts.dropped_points == 50
    assert states[-1].step.frames == 4
    assert np.linalg.norm(states[-1].T_odom_camera.matrix[:3, 3] - poses[5][:3, 3]) < 0.05


def test_lost_for_long_a_new_piece_begins(drive):
    scans, _ = drive
    chain = ScanOdometry(reach=2).start()
    nothing = LidarScan(np.zeros((0, 3), np.float32))
    fed = [scans[0], scans[1], nothing, nothing, nothing, scans[2]]
    states = [chain.register(scan, i * DT_NS) for i, scan in enumerate(fed)]
    assert [state.status for state in states] == ["first", "ok", "lost", "lost", "lost", "first"]
    assert states[-1].piece == 1


def test_points_with_times_are_moved_to_one_moment():
    # A car that starts from rest: scans then are skewed more and more.
    chain, plain, T = ScanOdometry().start(), ScanOdometry().start(), np.eye(4)
    for k, way_m in enumerate((0.0, 0.3, 0.6, 0.8, 0.8, 0.8)):
        step = np.array([way_m, 0.0, 0.0, 0.0, 0.0, 0.0])
        T = T @ exp_twist(step)
        still = yard([T])[0].xyz
        share = np.random.default_rng(k).uniform(-1.0, 0.0, len(still))
        moved = (still - share[:, None] * step[:3]).astype(np.float32)
        times = k * DT_NS + np.rint(share * DT_NS).astype(np.int64)
        scan = LidarScan(moved, timestamp_ns=k * DT_NS, point_times_ns=times)
        state = chain.register(scan, k * DT_NS)
        skewed = plain.register(replace(scan, point_times_ns=None), k * DT_NS)
    error_m, skewed_m = (
        np.linalg.norm(one.T_odom_camera.matrix[:3, 3] - T[:3, 3]) for one in (state, skewed)
    )
    assert chain.counts.deskewed == 4
    # What is left is of the first scan that moved, when no motion was known yet.
    assert error_m < 0.3 * skewed_m


def test_times_of_another_scan_are_refused(drive):
    scan = drive[0][0]
    times = np.full(len(scan), 5 * 10**9, np.int64)
    with pytest.raises(SequenceTime, match="taken 5 s from"):
        ScanOdometry().start().register(replace(scan, point_times_ns=times), 0)


def test_settings_without_meaning_are_refused():
    with pytest.raises(UsageError, match="voxels of 0 m"):
        ScanOdometry(voxel_m=0.0)


@pytest.mark.real
def test_the_velodyne_of_drive_2_against_its_imu(real_data: Path):
    source = KittiRaw(str(real_data / "kitti_raw")).open()
    frames = [source.load(i) for i in range(len(source.ids))]
    T_base_velo = left_in_base_link(source.rig).matrix @ source.rig.T_left_velodyne.matrix
    truth = [frame.pose.matrix @ T_base_velo for frame in frames]
    path = np.array([(inverted(truth[0]) @ T)[:3, 3] for T in truth])
    chain = ScanOdometry().start()
    states = [chain.register(frame.scan, frame.timestamp_ns) for frame in frames]
    assert [state.status for state in states[1:]] == ["ok"] * 9
    length_m = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    error_m = np.linalg.norm(states[-1].T_odom_camera.matrix[:3, 3] - path[-1])
    assert error_m < 0.007 * length_m  # 0.60 %
