"""Stereo visual odometry on rendered worlds, whose poses are exact."""

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import CalibrationSizeMismatch, SequenceTime, StructureError, UsageError
from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping import visual_odometry
from pseudolidar.mapping.odometry import Vision
from pseudolidar.mapping.registration import registered
from pseudolidar.mapping.visual_odometry import VisualOdometry
from pseudolidar.structures.box import Detection
from pseudolidar.structures.disparity import DisparityMap
from tests.mapping.worlds import Drive

# Of the way, at small pictures and over few frames.
MOST_ERROR_REL = 0.004


@pytest.fixture(scope="module")
def street():
    return Drive.through("street", 7, width_px=480)


@pytest.fixture(scope="module")
def driven(street):
    """States, and the odometry that told them."""
    odometry = VisualOdometry().start(street.rig)
    return [odometry.register(frame, frame.truth) for frame in street.frames], odometry


def black(frame):
    nothing = np.zeros_like(frame.left)
    return replace(frame, left=nothing, right=nothing)


def unknown(frame):
    return DisparityMap(np.full_like(frame.truth.values, np.nan))


def test_a_street_is_driven(street, driven):
    states, odometry = driven
    assert [state.status for state in states] == ["first", *["ok"] * 6]
    assert street.error_rel(states[-1]) < MOST_ERROR_REL
    assert all(state.inliers >= 100 for state in states[1:])
    assert 2 <= sum(state.keyframe for state in states) <= 6
    steps = np.linalg.multi_dot([state.step.T_from_to for state in states[1:]])
    assert np.allclose(steps, states[-1].T_odom_camera.matrix)
    (path,) = odometry.trajectories()
    error_m = np.linalg.norm(path.T_world_body[:, :3, 3] - street.T_odom[:, :3, 3], axis=1)
    assert error_m.max() < MOST_ERROR_REL * street.length_m
    assert path.timestamps_ns.tolist() == [frame.timestamp_ns for frame in street.frames]


def test_the_offset_is_told_frame_by_frame_as_it_is_learned(street, driven):
    states, odometry = driven
    told = [state.offset_px for state in states]
    assert told[0] == (0.0, 1.0)
    assert told[-1] == (odometry.offset.offset_px, odometry.offset.sigma_px)
    assert told[-1][1] < 0.5
    known = VisualOdometry(offset=False).start(street.rig)
    assert known.register(street.frames[0], street.frames[0].truth).offset_px is None


def test_the_same_poses_each_time(street, driven):
    odometry = VisualOdometry().start(street.rig)
    again = [odometry.register(frame, frame.truth) for frame in street.frames[:4]]
    for state, known in zip(again, driven[0], strict=False):
        assert np.array_equal(state.T_odom_camera.matrix, known.T_odom_camera.matrix)


@pytest.mark.parametrize("world", ["room", "flight"])
def test_other_worlds(world):
    drive = Drive.through(world, 4, width_px=360)
    odometry = VisualOdometry().start(drive.rig)
    states = [odometry.register(frame, frame.truth) for frame in drive.frames]
    error_m = np.linalg.norm(states[-1].T_odom_camera.translation_m - drive.T_odom[-1, :3, 3])
    # the room's steps are of a few centimetres, and its pixels of 5 mm
    assert error_m < MOST_ERROR_REL * drive.length_m + 0.003
    assert 0.05 < np.mean(drive.step_nees(states)) < 2.5
    assert drive.pose_nees(3, states[-1]) < 3


def test_covariances_are_honest(street, driven):
    states, _ = driven
    assert 0.1 < np.mean(street.step_nees(states)) < 2
    assert np.mean([street.pose_nees(at, states[at]) for at in range(1, 7)]) < 2
    grown = [np.linalg.det(state.covariance) for state in states[1:]]
    assert grown[-1] > grown[0]


def test_a_black_frame_is_lost_and_bridged(street):
    frames = street.frames
    odometry = VisualOdometry().start(street.rig)
    for frame in frames[:3]:
        odometry.register(frame, frame.truth)
    lost = odometry.register(black(frames[3]), unknown(frames[3]))
    assert (lost.status, lost.T_odom_camera, lost.step) == ("lost", None, None)
    assert "no pixel has a disparity" in lost.why
    found = odometry.register(frames[4], frames[4].truth)
    assert (found.status, found.step.frames, found.piece) == ("ok", 2, 0)
    assert street.error_rel(found, at=4) < MOST_ERROR_REL
    assert len(odometry.trajectories()[0]) == 4


def test_vision_alone_goes_on_as_before_where_it_is_dark(street):
    frames = street.frames
    odometry = Vision().start(street.rig)
    for frame in frames[:3]:
        odometry.register(frame, frame.truth)
    for at in (3, 4):
        dark = odometry.register(black(frames[at]), unknown(frames[at])).state
        assert (dark.status, dark.n_tracks, dark.step) == ("extrapolated", 0, None)
        assert street.error_rel(dark, at=at) < 0.02
        assert street.pose_nees(at, dark) < 1
    assert odometry.register(frames[5], frames[5].truth).state.step.frames == 3


def test_frames_that_were_cut_out_are_told_by_their_times(street, monkeypatch):
    guesses = []

    def noted(key, sight, rig, guess, correction, *, expected):
        guesses.append(guess)
        return registered(key, sight, rig, guess, correction, expected=expected)

    monkeypatch.setattr(visual_odometry, "registered", noted)
    odometry = VisualOdometry().start(street.rig)
    kept = (0, 1, 2, 5)
    for at in kept:
        found = odometry.register(street.frames[at], street.frames[at].truth)
    assert (found.status, found.step.frames) == ("ok", 1)
    assert street.error_rel(found, at=5) < 2 * MOST_ERROR_REL
    # the guess that led there went as far as three frames go
    T_key = street.T_odom[kept[3 - found.keyframe_gap]]
    off_m = np.linalg.norm((inverted(street.T_odom[5]) @ T_key @ inverted(guesses[-1]))[:3, 3])
    assert off_m < 0.2


def covered(frame, *, share):
    """Frame whose left lens is covered from the left side on, and disparities as matched then."""
    left, values = frame.left.copy(), frame.truth.values.copy()
    wide = int(share * left.shape[1])
    left[:, :wide], values[:, :wide] = 12, np.nan
    return replace(frame, left=left), DisparityMap(values)


def test_a_lens_that_is_covered_more_and_more(street):
    odometry = VisualOdometry().start(street.rig)
    shares = (0.0, 0.0, 0.3, 0.4, 0.995, 0.3, 0.0)
    states = [
        odometry.register(*covered(frame, share=share))
        for frame, share in zip(street.frames, shares, strict=True)
    ]
    assert [state.status for state in states[:5]] == ["first", "ok", "ok", "ok", "lost"]
    assert states[-1].status == "ok"
    for at, state in enumerate(states):
        if state.status == "lost":
            assert state.why
        else:  # a step of two frames with a third of the lens covered is 7 cm off, and knows it
            assert street.error_rel(state, at=at) < 5 * MOST_ERROR_REL
            assert at == 0 or street.pose_nees(at, state) < 6


def test_a_camera_that_delivers_one_picture_is_lost(street):
    first, second, third, fourth = street.frames[:4]
    odometry = VisualOdometry().start(street.rig)
    odometry.register(first, first.truth)
    frozen = replace(second, left=first.left, right=first.right)
    told = odometry.register(frozen, first.truth)
    assert told.status == "lost"
    assert "the same picture as the frame before" in told.why
    told = odometry.register(replace(third, right=third.left), third.truth)
    assert told.status == "lost"
    assert "left and right are the same" in told.why
    found = odometry.register(fourth, fourth.truth)
    assert (found.status, found.step.frames) == ("ok", 3)


def test_frames_out_of_order_are_refused(street):
    first, second = street.frames[:2]
    odometry = VisualOdometry().start(street.rig)
    odometry.register(second, second.truth)
    for wrong in (first, second):
        with pytest.raises(SequenceTime, match=f"frame {wrong.id}"):
            odometry.register(wrong, wrong.truth)


def test_a_new_piece_begins_after_long_darkness(street):
    frames = street.frames
    odometry = VisualOdometry(reach=1).start(street.rig)
    dark = odometry.register(black(frames[0]), unknown(frames[0]))
    assert (dark.status, dark.piece) == ("lost", 0)
    assert odometry.register(frames[1], frames[1].truth).status == "first"
    for frame in frames[2:5]:
        assert odometry.register(black(frame), unknown(frame)).status == "lost"
    anew = odometry.register(frames[5], frames[5].truth)
    assert (anew.status, anew.piece) == ("first", 1)
    assert np.array_equal(anew.T_odom_camera.matrix, np.eye(4))
    assert odometry.register(frames[6], frames[6].truth).piece == 1
    assert [len(path) for path in odometry.trajectories()] == [1, 2]


BOARD_PX = 160


def with_board(frame, *, at):
    """A board at 10 px of disparity, whose texture is the strongest in the picture."""
    noise = np.random.default_rng(3).integers(0, 256, (50, BOARD_PX // 2, 1), np.uint8)
    board = np.repeat(np.kron(noise, np.ones((2, 2, 1), np.uint8)), 3, axis=2)
    left, right, values = frame.left.copy(), frame.right.copy(), frame.truth.values.copy()
    left[20:120, at : at + BOARD_PX] = board
    right[20:120, at - 10 : at + BOARD_PX - 10] = board
    values[20:120, at : at + BOARD_PX] = 10.0
    return replace(frame, left=left, right=right), DisparityMap(values)


@pytest.mark.parametrize("known_by", ["box", "mask", "where it was", "where it is", None])
def test_movable_things_are_not_looked_at(street, known_by):
    known_in = {"where it was": [True, False, False], "where it is": [False, True, True]}
    known = known_in.get(known_by, [known_by is not None] * 3)
    odometry = VisualOdometry(offset=False).start(street.rig)
    for frame, at, told in zip(street.frames[:3], (60, 66, 72), known, strict=True):
        shown, disparity = with_board(frame, at=at)
        box_px = (at - 12.0, 8.0, at + BOARD_PX + 11.0, 131.0)
        mask = np.zeros(frame.left.shape[:2], np.bool_)
        mask[8:132, at - 12 : at + BOARD_PX + 12] = True
        thing = Detection("van", box_px, mask=mask if known_by == "mask" else None)
        state = odometry.register(shown, disparity, [thing] if told else [])
    u, v = state.tracks.uv_from.T
    on_board = (u >= 60) & (u < 60 + BOARD_PX) & (v >= 20) & (v < 120)
    error_m = np.linalg.norm(state.T_odom_camera.translation_m - street.T_odom[2, :3, 3])
    assert error_m < 0.02
    if known_by:
        assert not on_board.any()
    else:  # it was looked at, and told from the street by its motion
        assert on_board.any()


def test_what_does_not_fit_is_refused(street):
    frame = street.frames[0]
    with pytest.raises(UsageError, match="least_inliers"):
        VisualOdometry(least_inliers=3).start(street.rig)
    odometry = VisualOdometry().start(street.rig)
    with pytest.raises(StructureError, match="disparities of shape"):
        odometry.register(frame, DisparityMap(frame.truth.values[:-1]))
    small = Detection("car", (0.0, 0.0, 5.0, 5.0), mask=np.ones((3, 3), np.bool_))
    with pytest.raises(StructureError, match="a mask of shape"):
        odometry.register(frame, frame.truth, [small])
    with pytest.raises(CalibrationSizeMismatch):
        VisualOdometry().start(street.rig.scaled_to(960, 290)).register(frame, frame.truth)
