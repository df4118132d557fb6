"""Frames of which nothing is measured, in the midst of a yard that is driven through."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import OdometryLost
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.bridges import bridged
from pseudolidar.mapping.odometry import Kiss
from pseudolidar.mapping.path import stacked
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame
from tests.mapping.test_scan_odometry import DT_NS, yard

FRAMES, GOOD = 12, 4
EMPTY = LidarScan(np.zeros((0, 3), np.float32))
# As a driver does: 8 m/s and a slow turn, a little faster all the time, m a frame.
FASTER_M_PER_S2 = 2.0
SPEEDS = 0.75 + 0.01 * FASTER_M_PER_S2 * np.arange(FRAMES - 1)


@pytest.fixture(scope="module")
def drive():
    """Frames with scans of a yard, and the poses of their left camera in the first one."""
    rig = Synthetic("street", width_px=64, height_px=32).open().rig
    T_base = [np.eye(4)]
    for speed in SPEEDS:
        T_base.append(T_base[-1] @ exp_twist(np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.02])))
    T_base_left = left_in_base_link(rig).matrix
    truth = inverted(T_base_left) @ np.stack(T_base) @ T_base_left
    nothing = np.zeros((32, 64), np.uint8)
    frames = [
        StereoFrame(nothing, nothing, rig, f"{i:06d}", i, (i + 1) * DT_NS, scan=scan)
        for i, scan in enumerate(yard(T_base))
    ]
    return frames, truth


def cut(scan):
    """Scans that tell nothing: without points, of three, of points that are none."""
    return (EMPTY, LidarScan(scan.xyz[:3].copy()), LidarScan(np.full((500, 3), np.nan, np.float32)))


def driven(frames, bad, *, reach=5):
    """States, the odometry that told them, with scans spoilt in turns."""
    settings = Kiss()
    chain = replace(settings, scans=replace(settings.scans, reach=reach)).start(frames[0].rig)
    unknown = DisparityMap(np.full((32, 64), np.nan, np.float32))
    states = []
    for i, frame in enumerate(frames):
        scan = cut(frame.scan)[i % 3] if i in bad else frame.scan
        states.append(chain.register(replace(frame, scan=scan), unknown).state)
    return states, chain


def off(T, truth):
    return log_twist(inverted(T) @ truth)


def test_five_scans_that_tell_nothing_are_extrapolated_and_then_bridged(drive):
    frames, truth = drive
    bad = range(GOOD, GOOD + 5)
    states, chain = driven(frames, bad)
    assert [one.status for one in states] == [
        *("first", *["ok"] * 3),
        *["extrapolated"] * 5,
        *["ok"] * 3,
    ]
    assert states[GOOD + 5].step.frames == 6
    doubts, nees = [], []
    for i in bad:
        state = states[i]
        assert state.why
        assert (state.step, state.ended) == (None, None)
        error = off(state.T_odom_camera.matrix, truth[i])
        blind_s = 0.1 * (i - GOOD + 1)
        missed_m = 0.5 * FASTER_M_PER_S2 * blind_s * (blind_s + 0.1)
        assert np.linalg.norm(error[:3]) == pytest.approx(missed_m, abs=0.06)
        nees.append(error @ np.linalg.solve(state.covariance, error) / 6)
        doubts.append(np.linalg.det(state.covariance))
    assert np.all(np.diff(doubts) > 0)
    assert max(nees) < 1
    (path,) = chain.trajectories()
    assert len(path) == FRAMES - 5
    whole = bridged(path, np.array([frames[i].timestamp_ns for i in bad]))
    assert whole.timestamps_ns.tolist() == [frame.timestamp_ns for frame in frames]
    assert np.flatnonzero(whole.extrapolated).tolist() == list(bad)
    assert np.array_equal(whole.T_world_body[~whole.extrapolated], path.T_world_body)
    for i in bad:
        error = off(whole.T_world_body[i], truth[i])
        assert np.linalg.norm(error[:3]) < 0.1  # that of KISS-ICP, and of a tenth of the gap
        assert error @ np.linalg.solve(whole.covariance[i], error) / 6 < 2


def test_with_the_sixth_the_path_ends_at_the_last_good_pose(drive):
    frames, _ = drive
    states, chain = driven(frames, range(GOOD, GOOD + 6))
    assert [one.status for one in states[GOOD:]] == [*["extrapolated"] * 5, "lost", "first", "ok"]
    ended = states[GOOD + 5].ended
    assert isinstance(ended, OdometryLost)
    assert ended.where == f"frame {frames[GOOD - 1].id}"
    assert "more than 5 in a row" in ended.got
    assert [one.ended for one in states].count(None) == FRAMES - 1
    first, second = chain.trajectories()
    assert first.timestamps_ns[-1] == frames[GOOD - 1].timestamp_ns
    late = np.array([frame.timestamp_ns for frame in frames[GOOD : GOOD + 6]])
    for path in (first, second):
        assert len(bridged(path, late)) == len(path)


def test_a_long_silence_is_never_driven_through(drive):
    frames, _ = drive
    states, chain = driven(frames, range(3, FRAMES), reach=2)
    assert [one.status for one in states[3:]] == [*["extrapolated"] * 2, *["lost"] * 7]
    assert all(one.T_odom_camera is None for one in states[5:])
    assert [one.ended is not None for one in states].count(True) == 1
    assert [len(path) for path in chain.trajectories()] == [3]


def test_no_motion_is_made_up_that_was_never_seen(drive):
    frames, _ = drive
    states, _ = driven(frames[:4], {0, 2})
    assert [one.status for one in states] == ["lost", "first", "lost", "ok"]
    assert states[0].ended is None


def test_a_gap_that_is_too_long_holds_no_pose():
    poses = [exp_twist(np.array([0.0, 0.0, float(i), 0.0, 0.0, 0.0])) for i in (0, 1, 2, 62)]
    seconds = np.array([0, 1, 2, 62], np.int64)
    path = stacked(seconds * 10**9, poses, np.zeros((4, 6, 6)))
    whole = bridged(path, np.array([3, 30, 61], np.int64) * 10**9)
    assert len(whole) == 4
    assert not whole.extrapolated.any()
