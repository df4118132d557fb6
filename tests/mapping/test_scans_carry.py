"""Fused odometry on a street whose cameras are covered, or whose scans are empty."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import OdometryLost
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.mapping.odometry import Fused
from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan
from tests.mapping.worlds import Drive

FRAMES = 7
EMPTY = LidarScan(np.zeros((0, 3), np.float32))


@pytest.fixture(scope="module")
def street():
    return Drive.through("street", FRAMES, width_px=480)


def covered(frame):
    """With a hand before both lenses."""
    nothing = DisparityMap(np.full_like(frame.truth.values, np.nan))
    return replace(frame, left=0 * frame.left, right=0 * frame.right, truth=nothing)


def driven(drive, *, dark=(), scans=None, reach=5):
    """What fused odometry tells, with other scans at some frames, and its trajectories."""
    chain = Fused(VisualOdometry(reach=reach)).start(drive.rig)
    told = []
    for i, frame in enumerate(drive.frames):
        seen = covered(frame) if i in dark else frame
        seen = replace(seen, scan=(scans or {}).get(i, seen.scan))
        told.append(chain.register(seen, seen.truth))
    return told, chain.trajectories()


def errors_m(drive, told):
    return [
        np.linalg.norm(one.state.T_odom_camera.translation_m - T[:3, 3])
        for one, T in zip(told, drive.T_odom, strict=True)
        if one.state.T_odom_camera is not None
    ]


def test_scans_carry_on_where_the_cameras_are_covered_for_long(street):
    told, paths = driven(street, dark=range(2, 5), reach=2)
    assert [one.sensors for one in told] == [
        *("vision", "vision and scan"),
        *["scan"] * 3,
        *("scan", "vision and scan"),  # vision itself begins anew
    ]
    assert {one.state.piece for one in told} == {0}
    assert [one.state.status for one in told] == ["first", *["ok"] * 6]
    assert "no pixel has a disparity" in told[3].state.why
    assert max(errors_m(street, told)) < 0.02
    (path,) = paths
    assert len(path) == FRAMES
    assert np.abs(path.T_world_body[:, :3, 3] - street.T_odom[:, :3, 3]).max() < 0.02
    assert max(street.pose_nees(i, told[i].state) for i in range(1, FRAMES)) < 2
    assert max(street.step_nees([one.state for one in told])) < 2


def test_a_blink_is_bridged_by_vision_and_filled_in_by_scans(street):
    told, (path,) = driven(street, dark=[3])
    assert [told[i].sensors for i in (3, 4)] == ["scan", "vision and scan"]
    assert told[4].state.step.frames == 1
    assert max(errors_m(street, told)) < 0.02
    assert max(street.step_nees([one.state for one in told])) < 2
    assert path.timestamps_ns.tolist() == [frame.timestamp_ns for frame in street.frames]


def test_where_both_tell_nothing_it_is_extrapolated_until_one_does(street):
    told, _ = driven(street, dark=range(2, 6), scans={3: EMPTY, 4: EMPTY})
    assert [one.sensors for one in told[2:6]] == ["scan", "none", "none", "scan"]
    assert [one.state.status for one in told[2:6]] == ["ok", *["extrapolated"] * 2, "ok"]
    assert told[5].state.step.frames == 3
    assert max(errors_m(street, told)) < 0.04


def test_vision_goes_on_where_scans_are_empty(street):
    told, (path,) = driven(street, scans=dict.fromkeys((3, 4), EMPTY))
    assert [one.sensors for one in told[2:6]] == [
        *("vision and scan", "vision", "vision", "vision and scan"),
    ]
    assert max(errors_m(street, told)) < 0.02
    assert len(path) == FRAMES


@pytest.mark.parametrize("what", ["another place", "ground alone"])
def test_a_scan_that_does_not_say_where_carries_nothing(street, what):
    scan = street.frames[3].scan
    flat = LidarScan(scan.xyz[scan.xyz[:, 2] < -1.6].copy())
    T = exp_twist(np.array([3.0, 2.0, 0.5, 0.1, 0.1, 1.0]))
    moved = (scan.xyz @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
    wrong = flat if what == "ground alone" else LidarScan(moved)
    told, _ = driven(street, dark=[3], scans={3: wrong})
    assert (told[3].state.status, told[3].sensors) == ("extrapolated", "none")
    assert max(errors_m(street, told)) < 0.03


def test_the_path_ends_where_no_scan_joins_what_vision_begins_anew(street):
    told, paths = driven(street, dark=range(2, 5), scans={5: EMPTY}, reach=2)
    assert [one.state.status for one in told] == ["first", *["ok"] * 4, "first", "ok"]
    assert [one.state.piece for one in told] == [*[0] * 5, 1, 1]
    assert [len(path) for path in paths] == [5, 2]
    ended = told[5].state.ended
    assert (ended.where, "anew at frame 000005" in ended.got) == ("frame 000004", True)
    assert "0 frames" not in ended.got


def test_the_path_ends_where_both_are_silent_for_long(street):
    silent = range(2, 5)
    told, paths = driven(street, dark=silent, scans=dict.fromkeys(silent, EMPTY), reach=2)
    assert [one.state.status for one in told[2:]] == [*["extrapolated"] * 2, "lost", "first", "ok"]
    assert isinstance(told[4].state.ended, OdometryLost)
    assert [len(path) for path in paths] == [2, 2]
    assert [one.state.piece for one in told[5:]] == [1, 1]
