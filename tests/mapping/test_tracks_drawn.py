"""What odometry looked at, drawn."""

import numpy as np

from pseudolidar.mapping.tracks_drawn import RIGHT_RGB, WRONG_RGB, tracks_drawn, words_of
from pseudolidar.running.installation.part_trials import trial_frame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.point_tracks import PointTracks
from pseudolidar.structures.pose import Pose

POSE = Pose.identity("odom", "camera_left")
STEP = np.eye(4)
STEP[2, 3] = 1.25


def state():
    tracks = PointTracks(
        np.array([[40.0, 50.0], [140.0, 60.0]]),
        np.full(2, 8.0),
        np.array([[30.0, 50.0], [150.5, 60.0]]),
        np.full(2, 9.0),
    )
    return OdometryState(
        "ok",
        POSE,
        step=CameraStep(STEP, np.eye(6)),
        tracks=tracks,
        weights=np.array([1.0, 0.0]),
        keyframe_gap=3,
        keyframe=True,
    )


def test_points_and_their_ways_have_the_colour_of_their_weight():
    picture = tracks_drawn(trial_frame(), state())
    assert picture.shape == (*trial_frame().left.shape[:2], 3)
    for u in (30, 32, 35):
        assert np.abs(picture[50, u].astype(int) - RIGHT_RGB).max() < 60
    for u in (143, 146, 150):
        assert np.abs(picture[60, u].astype(int) - WRONG_RGB).max() < 60
    assert np.array_equal(tracks_drawn(trial_frame(), state()), picture)


def test_a_lost_frame_is_framed_and_says_why():
    lost = OdometryState("lost", why="too few points agree on a motion, 30 are wanted")
    picture = tracks_drawn(trial_frame(), lost)
    assert np.array_equal(picture[-1, 100], WRONG_RGB)
    assert picture[4:20, 8:100].max() > 200  # the words
    assert words_of(lost) == "lost: too few points agree on a motion, 30 are wanted"


def test_the_words_of_frames():
    assert words_of(OdometryState("first", POSE, piece=1)) == "first of piece 1"
    told = words_of(state())
    assert told == "1 of 2 points agree, keyframe 3 back, 1.250 m, next keyframe"
