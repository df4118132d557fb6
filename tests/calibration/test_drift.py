"""How the right eye is turned: known turns of rendered pairs, and rigs that put them right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.calibration.check import check_pair, seen_rotation
from pseudolidar.calibration.check_matches import PairMatches
from pseudolidar.calibration.check_rotation import rotation_found, turned
from pseudolidar.calibration.drift import LEAST_MATCHES, EyeRotation, RiggedMatches, eye_rotation
from pseudolidar.calibration.drift_rig import realigned_rig, remounted_rig
from pseudolidar.geometry.rectification import aligning_rotations, rectification
from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose
from tests.perturbed import right_turned, swapped

WORLDS = ("street", "room")
TURNS_DEG = ((0.05, 0.0, 0.0), (0.0, 0.0, 0.2), (-0.15, 0.3, -0.2), (0.3, -1.0, 0.5))
PITCH, YAW, ROLL = range(3)


@pytest.fixture(scope="module")
def pairs():
    """Two pairs of each world."""
    opened = {name: Synthetic(name, width_px=800, frames=8).open() for name in WORLDS}
    return {name: [source.load(index) for index in (0, 7)] for name, source in opened.items()}


def seen(frames) -> EyeRotation:
    rotation = seen_rotation([check_pair(frame) for frame in frames])
    assert rotation is not None
    return rotation


def shown(rig: StereoRig, points, turn_rad=(0, 0, 0), *, size_px=(800, 300)) -> RiggedMatches:
    """Where points (N, 3) in the left camera are seen by a rig whose right eye is turned."""
    turn = exp_twist(np.concatenate([np.zeros(3), turn_rad]))[:3, :3]
    in_right = points @ rig.T_right_left.matrix[:3, :3].T + rig.T_right_left.translation_m
    eyes = (points @ rig.left.K.T, in_right @ turn.T @ rig.right.K.T)
    left, right = (eye[:, :2] / eye[:, 2:] for eye in eyes)
    return RiggedMatches(PairMatches(left, right, size_px), rig)


def rig_of(t_m=(-0.5, 0.0, 0.0)) -> StereoRig:
    K = np.array([[500.0, 0, 399.5], [0, 500.0, 149.5], [0, 0, 1.0]])
    pose = Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array(t_m))
    eyes = (Camera(K, 800, 300, frame=f"camera_{eye}") for eye in ("left", "right"))
    return StereoRig(*eyes, pose)


def points(n=400, seed=0):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(4, 60, n)
    return (
        np.stack([rng.uniform(-0.7, 0.7, n), rng.uniform(-0.28, 0.28, n), np.ones(n)], 1)
        * (depth[:, None])
    )


@pytest.mark.parametrize("t_m", [(-0.5, 0.0, 0.0), (-0.5, 0.005, -0.003)], ids=["aligned", "off"])
@pytest.mark.parametrize("turn_deg", TURNS_DEG)
def test_exact_matches_give_the_exact_turn(turn_deg, t_m):
    turn_rad = np.radians(turn_deg)
    rotation = eye_rotation([shown(rig_of(t_m), points(), turn_rad)])
    np.testing.assert_allclose(rotation.rotation_rad, turn_rad, atol=1e-7)
    assert rotation.matches == 400


def test_of_exact_matches_lens_models_alone_leave_the_turn_unsure():
    """1 px in the corners looks like a yaw of 1 px / (x y), 0.05 px like pitch and roll."""
    found = eye_rotation([shown(rig_of(), points())])
    K = rig_of().right.K
    width, height = rig_of().right.size_px
    x, y = width / 2 / K[0, 0], height / 2 / K[1, 1]
    want = np.array([0.05, 1.0 / (x * y), 0.05 / x]) / K[1, 1]
    np.testing.assert_allclose(found.sigma_rad, want, rtol=1e-3)


def test_a_difference_of_focal_lengths_is_no_turn():
    pair = shown(rig_of(), points(), (0.002, 0, 0))
    centre = np.array([399.5, 149.5])
    grown = replace(pair.matches, right_px=centre + 1.004 * (pair.matches.right_px - centre))
    rotation = eye_rotation([replace(pair, matches=grown)])
    np.testing.assert_allclose(rotation.rotation_rad[[PITCH, ROLL]], [0.002, 0], atol=2e-5)


def test_wrong_matches_do_not_move_it():
    pair = shown(rig_of(), points(), (0.001, 0, -0.002))
    wrong = pair.matches.right_px.copy()
    wrong[::5, 1] += np.random.default_rng(1).uniform(-30, 30, len(wrong[::5]))
    rotation = eye_rotation([replace(pair, matches=replace(pair.matches, right_px=wrong))])
    np.testing.assert_allclose(rotation.rotation_rad[[PITCH, ROLL]], [0.001, -0.002], atol=1e-5)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("turn_deg", TURNS_DEG)
def test_turns_of_rendered_pairs_are_found_within_three_sigmas(pairs, world, turn_deg):
    rotation = seen([right_turned(frame, turn_deg) for frame in pairs[world]])
    off = (rotation.rotation_rad - np.radians(turn_deg)) / rotation.sigma_rad
    assert np.abs(off).max() < 3, off
    assert np.degrees(rotation.sigma_rad[[PITCH, ROLL]]).max() < 0.02
    assert rotation.believed[[PITCH, ROLL]].tolist() == [bool(turn_deg[0]), bool(turn_deg[2])]
    assert rotation.after_px < 0.4 * rotation.before_px
    found = rotation_found(rotation, pairs[world][0].rig)
    assert turned(rotation)
    assert found.severity == ("warn" if rotation.believed[YAW] else "note")
    assert found.figures["pitch_deg"] == pytest.approx(turn_deg[0], abs=0.03)
    assert "--out rig.json" in found.mend


@pytest.mark.parametrize("world", WORLDS)
def test_an_eye_that_is_not_turned_is_not_called_turned(pairs, world):
    rotation = seen(pairs[world])
    assert not rotation.believed.any()
    assert rotation_found(rotation, pairs[world][0].rig).severity == "good"
    rig = realigned_rig(pairs[world][0].rig, rotation)
    np.testing.assert_allclose(rig.rows.coefficients, 0, atol=1e-9)
    assert rig.correction is None


def test_what_does_not_tell_gives_nothing(pairs):
    few = shown(rig_of(), points(LEAST_MATCHES - 1))
    assert eye_rotation([few]) is None
    assert seen_rotation([check_pair(swapped(pairs["street"][0]))]) is None
    assert rotation_found(None, rig_of()).severity == "unknown"


@pytest.mark.parametrize(
    ("turn_deg", "left_px"), [((0.1, 0.0, 0.2), 0.12), ((0.0, -1.0, 0.3), 0.5)], ids=str
)
def test_the_realigned_rig_gives_back_disparities(pairs, turn_deg, left_px):
    frames = pairs["room"]
    rotation = seen([right_turned(frame, turn_deg) for frame in frames])
    rig, frame = realigned_rig(frames[0].rig, rotation), right_turned(frames[0], turn_deg)
    match = Census(quality="fast").load(min_depth_m=1.0)
    before = match(frame).values - frame.truth.values
    disparity = match(replace(frame, right=rows_aligned(frame.right, rig.rows))).values
    v, u = np.indices(disparity.shape, np.float64)
    corrected = disparity - rig.correction.offset_px(
        disparity.astype(np.float64), u, v, frame.size_px
    )
    error = np.abs(corrected - frame.truth.values)
    assert np.nanmedian(error) < left_px
    assert np.nanmedian(np.abs(before)) > 4 * np.nanmedian(error)
    assert "right eye turned" in rig.origin


def test_corrections_that_a_rig_has_are_added_to(pairs):
    frame = pairs["room"][0]
    rotation = EyeRotation(
        np.radians([0.1, 0, 0.2]), np.eye(3) * 1e-10, pairs=2, matches=900, before_px=1, after_px=0
    )
    once = realigned_rig(frame.rig, rotation)
    twice = realigned_rig(once, rotation)
    np.testing.assert_allclose(twice.rows.coefficients, 2 * once.rows.coefficients)
    np.testing.assert_allclose(twice.correction.coefficients, 2 * once.correction.coefficients)
    # A correction without one of the rows was fitted to disparities of the turned eye.
    fitted = frame.rig.with_correction(once.correction)
    assert realigned_rig(fitted, rotation).correction is once.correction


def test_the_remounted_rig_is_the_one_that_was_turned():
    """What is seen in rectified pictures, carried back to cameras that are mounted at an angle."""
    angles = np.array([0.02, -0.03, 0.015])
    R = exp_twist(np.concatenate([np.zeros(3), angles]))[:3, :3]
    pose = Pose.from_rotation("camera_right", "camera_left", R, np.array([-0.5, 0.01, -0.02]))
    said = replace(rig_of(), T_right_left=pose)
    turn_rad = np.array([0.002, 0.0, -0.003])
    R_left, R_right = aligning_rotations(pose)
    turn = R_right.T @ exp_twist(np.concatenate([np.zeros(3), turn_rad]))[:3, :3] @ R_right
    true = np.eye(4)
    true[:3, :3] = turn
    true = true @ pose.matrix
    rectified = rectification(said).rig
    seen_points = points()
    in_left = seen_points @ R_left.T
    in_right = (seen_points @ true[:3, :3].T + true[:3, 3]) @ R_right.T
    left, right = ((eye @ rectified.left.K.T)[:, :2] / eye[:, 2:] for eye in (in_left, in_right))
    pair = RiggedMatches(PairMatches(left, right, rectified.left.size_px), rectified)
    rotation = eye_rotation([pair])
    np.testing.assert_allclose(rotation.rotation_rad, turn_rad, atol=1e-7)
    sure = replace(rotation, covariance=np.eye(3) * 1e-12)
    mounted = remounted_rig(said, R_right, sure)
    np.testing.assert_allclose(mounted.T_right_left.matrix, true, atol=1e-7)
