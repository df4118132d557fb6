"""Stereo visual odometry on rendered worlds, whose poses are exact."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.sources.synthetic import Synthetic

FRAMES = 4


@pytest.fixture(scope="module")
def street():
    """Frames of a small street, with exact disparities and camera poses in the first one."""
    source = Synthetic("street", frames=FRAMES, width_px=620).open()
    frames = [source.load(i) for i in range(FRAMES)]
    T_base_left = left_in_base_link(source.rig).matrix
    T_map = [frame.pose.matrix @ T_base_left for frame in frames]
    return frames, [np.linalg.inv(T_map[0]) @ T for T in T_map]


def test_a_street_is_driven(street):
    frames, truth = street
    odometry = VisualOdometry().start(frames[0].rig)
    states = [odometry.register(frame, frame.truth) for frame in frames]
    assert [state.status for state in states] == ["first", "ok", "ok", "ok"]
    length_m = np.linalg.norm(truth[-1][:3, 3])
    error_m = np.linalg.norm(states[-1].T_odom_camera.translation_m - truth[-1][:3, 3])
    assert error_m < 0.005 * length_m
    assert all(state.inliers >= 100 for state in states[1:])
    steps = np.linalg.multi_dot([state.step.T_from_to for state in states[1:]])
    assert np.allclose(steps, states[-1].T_odom_camera.matrix)


def test_a_black_frame_is_lost_and_bridged(street):
    frames, truth = street
    odometry = VisualOdometry().start(frames[0].rig)
    odometry.register(frames[0], frames[0].truth)
    black = np.zeros_like(frames[1].left)
    nothing = replace(frames[1].truth, values=np.full_like(frames[1].truth.values, np.nan))
    lost = odometry.register(replace(frames[1], left=black, right=black), nothing)
    assert lost.status == "lost"
    assert lost.T_odom_camera is None
    assert "points" in lost.why
    found = odometry.register(frames[2], frames[2].truth)
    assert (found.status, found.step.frames) == ("ok", 2)
    assert np.linalg.norm(found.T_odom_camera.translation_m - truth[2][:3, 3]) < 0.02


def test_settings_without_meaning_are_refused(street):
    with pytest.raises(UsageError, match="least_inliers"):
        VisualOdometry(least_inliers=3).start(street[0][0].rig)
