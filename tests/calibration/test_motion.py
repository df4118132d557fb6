"""The offset from motion: on computed tracks, and on rendered pictures with a planted offset."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.far_points import FarPoints
from pseudolidar.calibration.motion import Motion
from pseudolidar.calibration.motion_fit import fitted
from pseudolidar.calibration.motion_scale import depth_scale
from pseudolidar.errors import MotionInsufficient, UsageError
from pseudolidar.geometry.motion_offset import (
    correction_coefficients,
    joint_offset,
    shape_of,
)
from pseudolidar.geometry.pnp import refined_pose
from pseudolidar.geometry.tracking import MatchedPair
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.structures.camera import UNREFINED_SIGMA_PX
from pseudolidar.structures.correction import DisparityCorrection
from tests.moving_rig import STEP, motions_of, rig, tracks

NO_FAR = FarPoints(0, None, None)


def fit_of(of, seen, *, gap=3):
    motions = [refined_pose(T, each, of) for T, each in seen]
    return fitted(motions, of, frames=len(seen) + gap, gap=gap, far=NO_FAR)


@pytest.mark.parametrize("planted_px", [-0.9, -0.2, 0.0, 0.35])
@pytest.mark.parametrize("doffs_px", [0.0, 8.0])
def test_a_planted_offset_is_found(planted_px, doffs_px):
    of = rig(doffs_px=doffs_px)
    fit = fit_of(of, motions_of(of, 12, offset_px=planted_px, noise_px=0.2, outliers=0.2))
    assert fit.offset_px == pytest.approx(planted_px, abs=0.03)
    assert abs(fit.offset_px - planted_px) < 2 * fit.sigma_px


def test_the_spread_of_blocks_is_that_of_sequences():
    """12 sequences: their estimates scatter as each says that it is unsure."""
    of, errors, claims = rig(), [], []
    for seed in range(12):
        seen = [
            (T, tracks(of, T, n=150, offset_px=0.3, noise_px=0.25, seed=100 * seed + i))
            for i, (T, _) in enumerate(motions_of(of, 12, n=20))
        ]
        fit = fit_of(of, seen)
        errors.append(fit.offset_px - 0.3)
        claims.append(fit.blocks_px)
    # a standard deviation of 12 is known to 21 %, and blocks of a few motions tell it to 40 %
    assert np.std(errors) == pytest.approx(np.median(claims), rel=0.6)


def test_a_wrong_baseline_is_not_seen():
    """All lengths are too large alike; nothing contradicts that."""
    of = rig()
    longer = replace(
        of, T_right_left=replace(of.T_right_left, matrix=of.T_right_left.matrix.copy())
    )
    longer.T_right_left.matrix[0, 3] *= 1.05
    fit = fit_of(longer, motions_of(of, 12, noise_px=0.2))
    assert fit.offset_px == pytest.approx(0.0, abs=0.03)
    assert any("scale f B cannot be seen" in line for line in fit.lines)
    assert fit.as_dict()["scale_seen"] is False
    assert fit.correction.residual_px >= UNREFINED_SIGMA_PX


def longer(of, factor):
    """The rig with a baseline that is said to be too long."""
    matrix = of.T_right_left.matrix.copy()
    matrix[0, 3] *= factor
    return replace(of, T_right_left=replace(of.T_right_left, matrix=matrix))


@pytest.mark.parametrize("doffs_px", [0.0, 8.0])
def test_poses_tell_the_scale_that_motion_does_not(doffs_px):
    """Offset, bend and baseline are all wrong; depths at all disparities and columns are right."""
    of = rig(doffs_px=doffs_px)
    wrong = longer(of, 1.03)
    planted = {"offset_px": -0.5, "bend_px": -1.0}
    seen = motions_of(of, 12, noise_px=0.1, **planted)
    motions = [refined_pose(T, each, wrong) for T, each in seen]
    poses = [T for T, _ in seen]
    fit = fitted(motions, wrong, frames=15, gap=3, far=NO_FAR, surveyed=poses)
    assert fit.scale.factor == pytest.approx(1 / 1.03, abs=0.002)
    assert abs(fit.scale.factor - 1 / 1.03) < 2 * fit.as_dict()["scale_sigma_rel"]
    assert fit.as_dict()["scale_seen"] is True
    assert "by the poses of the source" in "".join(fit.lines)
    assert fit.correction.residual_px < 0.6 * UNREFINED_SIGMA_PX
    u, depth_m = np.linspace(50, 1200, 30), np.geomspace(6, 80, 30)
    d = of.fB_px_m / depth_m - doffs_px + shape_of(u, of, 2) @ np.array([-0.5, -1.0])
    d = d - fit.correction.offset_px(d, u, np.full(30, 99.0), of.left.size_px)
    off_px = wrong.fB_px_m / (d + doffs_px) / depth_m - 1
    assert np.abs(off_px * of.fB_px_m / depth_m).max() < 0.15


def test_without_poses_near_depths_stay_as_calibrated():
    """The nearest tenth hardly moves, what is far moves by all of the offset."""
    of = rig()
    fit = fit_of(of, motions_of(of, 12, offset_px=-0.5, noise_px=0.1))
    assert fit.scale.by == "near"
    near_m, far_m = fit.depths_m
    assert fit.scale.near_m == pytest.approx(near_m, rel=0.02)
    u = np.full(2, of.left.K[0, 2])
    d = of.fB_px_m / np.array([near_m, 10 * far_m])
    moved_px = fit.correction.offset_px(d, u, np.full(2, 99.0), of.left.size_px)
    # moved near the axis by what the sides, where 1 + x^2 is 1.8, are moved by less
    assert abs(moved_px[0]) < 0.15
    assert moved_px[1] == pytest.approx(-0.5, abs=0.03)
    assert fit.correction.residual_px >= UNREFINED_SIGMA_PX
    assert any("stay as calibrated" in line for line in fit.lines)


def test_the_scale_can_be_kept_for_a_camera_that_turned():
    of = rig()
    motions = [refined_pose(T, each, of) for T, each in motions_of(of, 12, offset_px=-0.5)]
    poses = [motion.T_to_from @ exp_twist(0.1 * STEP) for motion in motions]
    options = {"frames": 15, "gap": 3, "far": NO_FAR, "surveyed": poses}
    fit = fitted(motions, of, scale="kept", **options)
    assert (fit.scale.by, fit.scale.factor) == ("kept", 1.0)
    assert fit.correction.coefficients[1] == 0.0
    # a survey a tenth off is no error of a calibration
    assert fitted(motions, of, **options).scale.by == "near"
    with pytest.raises(MotionInsufficient, match="more than a calibration errs by"):
        fitted(motions, of, scale="poses", **options)


def test_poses_that_disagree_among_themselves_do_not_count():
    of = rig()
    motions = [refined_pose(T, each, of) for T, each in motions_of(of, 12)]
    poses = [motion.T_to_from.copy() for motion in motions]
    for number, pose in enumerate(poses):
        pose[:3, 3] *= 1 + 0.08 * (-1) ** number
    options = {"frames": 15, "gap": 3, "far": NO_FAR, "surveyed": poses}
    fit = fitted(motions, of, **options)
    assert fit.scale.by == "near"
    assert "not used" in "".join(fit.lines)
    with pytest.raises(MotionInsufficient, match=r"--by\.scale"):
        fitted(motions, of, scale="poses", **(options | {"surveyed": ()}))


def test_the_scale_follows_offset_and_bend_as_said():
    """Derivatives by finite differences, of poses and of near depths."""
    of, planted = rig(), 0.05
    plain, moved = (
        [refined_pose(T, each, of) for T, each in motions_of(of, 8, offset_px=offset_px)]
        for offset_px in (0.0, planted)
    )
    poses = [motion.T_to_from for motion in plain]
    found = joint_offset(plain, of)
    # the pictures of an offset rig, looked at as if it had none: as an offset the other way
    held = [refined_pose(m.T_to_from, m.tracks, of) for m in moved]
    change = np.median([m.distance_m for m in held]) - np.median([m.distance_m for m in plain])
    assert np.median(found.length_by_shape) == pytest.approx(-change / planted, rel=0.1)
    scale = depth_scale(found, of, poses, gap=3, by="poses")
    assert scale.by_shape[0] == pytest.approx(change / planted / plain[0].distance_m, rel=0.1)


def test_the_correction_is_as_unsure_as_the_offset():
    of = rig()
    motions = [refined_pose(T, each, of) for T, each in motions_of(of, 12, offset_px=0.3)]
    fits = {
        by: fitted(motions, of, frames=15, gap=3, far=NO_FAR, scale=by) for by in ("kept", "near")
    }
    d = np.array([0.0, 9.0, 60.0])
    at_axis = d, *(np.full(3, centre) for centre in of.left.K[:2, 2])
    sigma_px = {
        by: fit.correction.offset_sigma_px(*at_axis, of.left.size_px) for by, fit in fits.items()
    }
    np.testing.assert_allclose(sigma_px["kept"], fits["kept"].sigma_px)
    assert fits["kept"].correction.fitted_m == fits["kept"].depths_m
    # where near depths stay, an error of the offset moves what is far
    assert sigma_px["near"][0] == pytest.approx(fits["near"].sigma_px)
    assert (np.diff(sigma_px["near"][:2]) < 0).all()
    assert sigma_px["near"][2] < 0.3 * fits["near"].sigma_px


def test_surveyed_poses_are_compared_with():
    of = rig()
    seen = motions_of(of, 12, offset_px=0.3, noise_px=0.1)
    motions = [refined_pose(T, each, of) for T, each in seen]
    poses = [T for T, _ in seen]
    fit = fitted(motions, of, frames=15, gap=3, far=NO_FAR, surveyed=poses)
    assert fit.by_poses_px == (pytest.approx(0.3, abs=0.01), 0.0)
    assert any("held fixed" in line for line in fit.lines)
    # the offset is compared with it and does not follow it
    wrong = [T @ exp_twist(np.array([0, 0, 0.3, 0, 0, 0])) for T in poses]
    assert fitted(motions, of, frames=15, gap=3, far=NO_FAR, surveyed=wrong).offset_px == (
        fit.offset_px
    )


def test_the_correction_is_the_shape_of_the_offset():
    of = rig()
    u, shape_px = np.linspace(0, 1241, 50), np.array([-0.4, 0.9])
    correction = DisparityCorrection(correction_coefficients(shape_px, of), 0.0)
    offsets = correction.offset_px(np.full(50, 20.0), u, np.full(50, 99.0), of.left.size_px)
    assert np.allclose(offsets, shape_of(u, of, 2) @ shape_px, atol=1e-12)


@pytest.mark.parametrize("bend_px", [-1.2, 0.0, 0.1])
def test_a_bend_is_taken_where_it_is_sure(bend_px):
    of = rig()
    seen = motions_of(of, 12, offset_px=0.2, bend_px=bend_px, noise_px=0.2)
    fit = fit_of(of, seen)
    if abs(bend_px) < 0.4:
        assert fit.bend_px == 0.0
    else:
        assert fit.bend_px == pytest.approx(bend_px, abs=0.15)
        assert "x^2" in fit.offset_text.partition("(1 + x^2)")[2]
    assert fit.offset_px == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize(
    ("options", "twist", "missing"),
    [
        ({}, np.zeros(6), "moves 0.0"),
        ({}, np.array([0, 0, 0, 0.0, 0.05, 0]), "moves 0.0"),
        ({"depths_m": (19.0, 21.0)}, STEP, "depth range"),
    ],
    ids=["standing", "turning on the spot", "a wall"],
)
def test_what_motion_cannot_tell_is_refused(options, twist, missing):
    of, T = rig(), exp_twist(twist)
    seen = [(T, tracks(of, T, noise_px=0.2, seed=i, **options)) for i in range(9)]
    with pytest.raises(MotionInsufficient, match="MotionInsufficient") as refusal:
        fit_of(of, seen)
    assert missing in str(refusal.value)


def test_motions_that_disagree_are_refused():
    of = rig()
    seen = [
        (T, tracks(of, T, offset_px=2.0 * (-1) ** (i // 3), seed=i))
        for i, (T, _) in enumerate(motions_of(of, 12, n=20))
    ]
    with pytest.raises(MotionInsufficient, match="disagree"):
        fit_of(of, seen)


def test_a_few_frames_are_refused():
    of = rig()
    with pytest.raises(MotionInsufficient, match=r"5 frame\(s\); wanted 9 or more"):
        fit_of(of, motions_of(of, 2))


def test_long_sequences_are_taken_evenly():
    plan = Motion(gap=3, most=10)
    assert plan.starts(8) == (0, 1, 2, 3, 4)
    assert plan.starts(2) == ()
    starts = plan.starts(1000)
    assert len(starts) == 10
    assert (starts[0], starts[-1]) == (0, 996)
    assert set(np.diff(starts)) <= {110, 111}
    assert len(plan.needed(1000)) == 40
    with pytest.raises(UsageError):
        Motion(gap=0)


# --- pictures ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flight():
    source = Synthetic("flight", frames=11, seed=3, width_px=480).open()
    return [source.load(i) for i in range(11)]


def with_offset(frame, offset_px):
    """The right picture as a turned camera would take it."""
    height, width = frame.right.shape[:2]
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    turned = shape_of(u[0].astype(float), frame.rig, 1)[:, 0]
    shifted = (u + offset_px * turned).astype(np.float32)
    right = cv2.remap(frame.right, shifted, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return replace(frame, right=right)


def fit_of_pictures(frames, positions=None, **settings):
    match = Census().load()
    positions = range(len(frames)) if positions is None else positions
    estimator = Motion(**settings).load(frames[0].rig, len(frames))
    for position, frame in zip(positions, frames, strict=True):
        estimator.add(position, MatchedPair.of(frame, match(frame)))
    return estimator.fit()


@pytest.mark.parametrize("planted_px", [-0.5, 0.0, 0.3])
def test_a_turned_camera_is_found_in_pictures(flight, planted_px):
    fit = fit_of_pictures([with_offset(frame, planted_px) for frame in flight])
    # Half-size pictures, the far field a few pixels of disparity: tracks err by 0.03 px together.
    assert fit.offset_px == pytest.approx(planted_px, abs=0.05)
    assert abs(fit.offset_px - planted_px) < 2 * fit.sigma_px
    assert (fit.motions, fit.frames) == (8, 11)
    assert fit.step_m == pytest.approx(1.8, abs=0.3)  # 6 m/s and some climb, 0.3 s


def test_impossible_disparities_are_told(flight):
    fit = fit_of_pictures([with_offset(frame, -1.6) for frame in flight])
    assert fit.far.too_small_px > 0.3
    assert "impossible" in fit.far.conclusion
    sound = fit_of_pictures(flight).far
    assert sound.too_small_px == 0.0
    assert "no more than noise" in sound.conclusion


def test_frames_that_do_not_follow_one_another_are_refused(flight):
    with pytest.raises(MotionInsufficient, match="only 0 motions"):
        fit_of_pictures(flight, positions=range(0, 22, 2))


def test_a_picture_without_texture_costs_its_motions_only(flight):
    grey = np.full_like(flight[0].left, 90)
    frames = [*flight[:1], replace(flight[1], left=grey, right=grey + 1), *flight[2:]]
    fit = fit_of_pictures(frames)
    assert fit.motions == 6
    assert fit.offset_px == pytest.approx(0.0, abs=0.05)


def test_few_distant_points_say_nothing():
    assert "too few" in FarPoints.of([np.full(10, -1.0)]).conclusion
    assert FarPoints.of([]).as_dict()["n"] == 0
