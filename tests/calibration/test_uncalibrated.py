"""Cameras found from matches alone: rows, shape, scale; and what tells too little."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.check_matches import PairMatches, match_points
from pseudolidar.calibration.known_distance import (
    KnownDistance,
    said_scale,
    scaled_rig,
    seen_scale,
)
from pseudolidar.calibration.uncalibrated import fit_uncalibrated
from pseudolidar.errors import CalibrationValue, PairSwapped, UsageError
from pseudolidar.geometry.rectification import rectification
from pseudolidar.geometry.rectified_pixels import PairMaps
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose

SIZE_PX, FOCAL_PX = (640, 480), 500.0
K = np.array([[FOCAL_PX, 0, 319.5], [0, FOCAL_PX, 239.5], [0, 0, 1.0]])
# A stick that somebody screwed two cameras to: degrees about x, y, z, and where the right one is.
TURNED_DEG, RIGHT_AT = (2.0, -3.0, 4.0), np.array([0.2, 0.01, -0.015])


def turn(degrees):
    return exp_twist(np.concatenate([np.zeros(3), np.radians(degrees)]))[:3, :3]


def points(n=600, seed=0):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1.0, 12.0, n)
    view = np.stack([rng.uniform(-0.5, 0.5, n), rng.uniform(-0.4, 0.4, n), np.ones(n)], axis=1)
    return view * depth[:, None]


def seen(xyz, *, noise_px=0.0, R=None):
    """Matches of points by two cameras that are not alike, and what the right one is turned by."""
    R = turn(TURNED_DEG) if R is None else R
    left, right = xyz @ K.T, (xyz - RIGHT_AT) @ R.T @ K.T
    rng = np.random.default_rng(1)
    left, right = (
        eye[:, :2] / eye[:, 2:] + rng.normal(0, noise_px, (len(xyz), 2)) for eye in (left, right)
    )
    return PairMatches(left, right, SIZE_PX)


def hartley_rows_px(matches):
    """Median row difference after OpenCV's stereoRectifyUncalibrated."""
    cv2.setRNGSeed(0)
    F, mask = cv2.findFundamentalMat(
        matches.left_px, matches.right_px, cv2.USAC_MAGSAC, 1.0, 0.999, 5000
    )
    agree = mask.ravel() > 0
    left, right = matches.left_px[agree], matches.right_px[agree]
    _, *homographies = cv2.stereoRectifyUncalibrated(left, right, F, matches.size_px)
    flat = [
        cv2.perspectiveTransform(px[:, None], H)[:, 0]
        for px, H in zip((left, right), homographies, strict=True)
    ]
    return float(np.median(np.abs(flat[0][:, 1] - flat[1][:, 1])))


def projective_residual(estimated, true):
    """Median share by which points (N, 4) differ after the best map of projective space."""
    scale = [np.linalg.norm(each, axis=1, keepdims=True) for each in (estimated, true)]
    a, b = estimated / scale[0], true / scale[1]
    rows = []
    for i, j in ((0, 3), (1, 3), (2, 3), (0, 2), (1, 2), (0, 1)):
        block = np.zeros((len(a), 16))
        block[:, 4 * i : 4 * i + 4] = a * b[:, j : j + 1]
        block[:, 4 * j : 4 * j + 4] = -a * b[:, i : i + 1]
        rows.append(block)
    H = np.linalg.svd(np.concatenate(rows), full_matrices=False)[2][-1].reshape(4, 4)
    mapped, wanted = a @ H.T, b
    return float(
        np.median(
            np.linalg.norm(mapped[:, :3] / mapped[:, 3:] - wanted[:, :3] / wanted[:, 3:], axis=1)
            / np.linalg.norm(wanted[:, :3] / wanted[:, 3:], axis=1)
        )
    )


def placed(fit, matches):
    """(N, 4) homogeneous points that a fit puts matches at."""
    plan = rectification(fit.rig)
    eyes = ((matches.left_px, plan.raw.left.K, plan.R_left),
            (matches.right_px, plan.raw.right.K, plan.R_right))  # fmt: skip
    flat = []
    for px, K_raw, R in eyes:
        at = np.hstack([px, np.ones((len(px), 1))]) @ (plan.rig.left.K @ R @ np.linalg.inv(K_raw)).T
        flat.append(at[:, :2] / at[:, 2:])
    d = flat[0][:, 0] - flat[1][:, 0]
    homogeneous = np.column_stack([flat[0], d, np.ones(len(d))]) @ plan.rig.Q.T
    return homogeneous, np.abs(flat[0][:, 1] - flat[1][:, 1])


def test_the_pose_comes_out_of_exact_matches_but_for_its_scale():
    matches = seen(points())
    fit = fit_uncalibrated([matches], focal_px=FOCAL_PX)
    R = turn(TURNED_DEG)
    np.testing.assert_allclose(fit.rig.T_right_left.matrix[:3, :3], R, atol=1e-5)
    t = -R @ RIGHT_AT
    between = fit.rig.T_right_left.translation_m
    np.testing.assert_allclose(between / np.linalg.norm(between), t / np.linalg.norm(t), atol=1e-4)
    assert (fit.focal_from, fit.agreeing, fit.rig.metric) == ("given", 600, False)
    assert fit.after_px < 1e-4 < 10 < fit.before_px
    xyz, _ = placed(fit, matches)
    lengths = np.linalg.norm(xyz[:, :3] / xyz[:, 3:], axis=1) / np.linalg.norm(points(), axis=1)
    unit = np.linalg.norm(fit.rig.T_right_left.translation_m) / np.linalg.norm(RIGHT_AT)
    np.testing.assert_allclose(lengths, unit, rtol=1e-3)
    nearest = np.quantile(xyz[:, 2] / xyz[:, 3], 0.01)
    assert nearest == pytest.approx(1.25 * 3.0, rel=0.1)


def test_without_a_focal_length_rows_meet_and_the_shape_is_right_up_to_a_projectivity():
    matches = seen(points(), noise_px=0.2, R=turn((1.0, -1.0, 2.0)))
    fit = fit_uncalibrated([matches])
    assert fit.focal_from in ("assumed", "seen")
    xyz, rows_px = placed(fit, matches)
    assert fit.after_px <= 1.05 * hartley_rows_px(matches)
    assert np.median(rows_px) < 0.3
    true = np.hstack([points(), np.ones((600, 1))])
    assert projective_residual(xyz, true) < 0.02


def test_wrong_matches_are_left_out():
    matches = seen(points(), noise_px=0.1)
    right = matches.right_px.copy()
    right[::3] = np.random.default_rng(2).uniform(0, 480, right[::3].shape)
    fit = fit_uncalibrated([replace(matches, right_px=right)], focal_px=FOCAL_PX)
    assert fit.agreeing == pytest.approx(400, abs=30)
    np.testing.assert_allclose(fit.rig.T_right_left.matrix[:3, :3], turn(TURNED_DEG), atol=3e-3)


def test_nothing_lies_behind_infinity():
    """A lens that bends corners is taken for a yaw, which puts far things behind infinity."""
    matches = seen(points(), R=turn((0.0, 0.5, 0.0)))
    xy = (matches.right_px - K[:2, 2]) / FOCAL_PX
    keystone = np.stack([np.zeros(600), -0.03 * xy[:, 0] * xy[:, 1]], axis=1) * FOCAL_PX
    bent = replace(matches, right_px=matches.right_px + keystone)
    fit = fit_uncalibrated([bent], focal_px=FOCAL_PX)
    assert fit.moved_px > 5
    assert fit.far_px == pytest.approx(1.0, abs=0.2)
    xyz, rows_px = placed(fit, bent)
    assert np.mean(xyz[:, 2] / xyz[:, 3] > 0) > 0.98
    assert np.median(rows_px) < 0.1


def test_exchanged_eyes_are_named():
    matches = seen(points())
    other = PairMatches(matches.right_px, matches.left_px, SIZE_PX)
    with pytest.raises(PairSwapped):
        fit_uncalibrated([other], focal_px=FOCAL_PX)


def test_what_tells_too_little_is_refused():
    with pytest.raises(CalibrationValue, match="0 of 40 matches agree"):
        fit_uncalibrated([seen(points(40))])
    noise = np.random.default_rng(3).uniform(0, 480, (2, 300, 2))
    with pytest.raises(CalibrationValue):
        fit_uncalibrated([PairMatches(*noise, SIZE_PX)])


@pytest.fixture(scope="module")
def room():
    """Two pairs of the room, their right eye turned and moved as on the stick."""
    source = Synthetic("room", width_px=640, frames=5).open()
    return [source.load(index) for index in (0, 4)]


def test_a_rendered_room_with_its_rig_withheld(room):
    frames, true = room, room[0].rig
    bend = true.right.K @ turn((1.0, 0.5, -2.0)) @ np.linalg.inv(true.right.K)
    bent = [cv2.warpPerspective(f.right, bend, f.size_px, flags=cv2.INTER_CUBIC) for f in frames]
    matches = [match_points(f.left, right) for f, right in zip(frames, bent, strict=True)]
    fit = fit_uncalibrated(matches, focal_px=true.left.focal_px)
    assert fit.before_px > 3
    assert fit.after_px < 0.1
    assert fit.held_px < 0.1
    plan = rectification(fit.rig)
    pair = PairMaps.of(plan).apply(frames[0].left, bent[0])
    flat = replace(frames[0], left=pair[0], right=pair[1], rig=plan.rig, truth=None)
    disparity = Census(quality="fast").load(min_depth_m=1.0)(flat)
    # A box on the floor in front, and two points of it, whose places the truth tells.
    depth_m = true.fB_px_m / frames[0].truth.values
    u, v = true.left.width_px // 2, 400
    known = f"box:{u - 20},{v - 5},{u + 20},{v + 5}={depth_m[v, u]:.4f}"
    metric = scaled_rig(fit.rig, seen_scale(KnownDistance.parse(known), plan, disparity))
    assert metric.metric
    between_m = np.linalg.norm(metric.T_right_left.translation_m)
    assert between_m == pytest.approx(true.baseline_m, rel=0.05)
    ends = np.array([[u - 80, v], [u + 80, v + 30]])
    views = np.hstack([ends, np.ones((2, 1))]) @ np.linalg.inv(true.left.K).T
    places = views * depth_m[ends[:, 1], ends[:, 0]][:, None]
    apart_m = np.linalg.norm(places[0] - places[1])
    known = f"points:{','.join(map(str, ends.ravel()))}={apart_m:.4f}"
    by_points = seen_scale(KnownDistance.parse(known), plan, disparity)
    units = np.linalg.norm(fit.rig.T_right_left.translation_m)
    assert by_points.metres * units == pytest.approx(true.baseline_m, rel=0.05)
    assert by_points.sigma_share < 0.1
    # An error that all disparities share is the greater part of what the result says of itself.
    assert fit.offset_sigma_px > 0.03 * true.left.width_px
    for text in (known, f"box:{u - 20},{v - 5},{u + 20},{v + 5}=1"):
        told = KnownDistance.parse(text)
        alone = seen_scale(told, plan, disparity)
        both = seen_scale(told, plan, disparity, offset_sigma_px=fit.offset_sigma_px)
        assert both.metres == alone.metres
        assert both.sigma_share > max(0.1, 2 * alone.sigma_share)


def test_known_distances_are_read_as_they_are_written():
    for text in ("baseline:0.12", "points:10,20,30.5,40=1.8", "box:1,2,3,4=5@000007"):
        assert str(KnownDistance.parse(text)) == text
    for bad in (
        "0.12",
        "baseline:0",
        "baseline:-1",
        "box:1,2,3=4",
        "points:1,2,3,4",
        "box:a,b,c,d=1",
    ):
        with pytest.raises(UsageError, match=r"baseline:0\.12"):
            KnownDistance.parse(bad)


def test_a_known_baseline_and_pixels_that_show_nothing(room):
    fit = fit_uncalibrated([seen(points())], focal_px=FOCAL_PX)
    scaled = scaled_rig(fit.rig, said_scale(KnownDistance.parse("baseline:0.2"), fit.rig))
    assert np.linalg.norm(scaled.T_right_left.translation_m) == pytest.approx(0.2)
    assert "0.2 m apart, as said" in scaled.origin
    plan = rectification(fit.rig)
    nothing = replace(room[0].truth, values=np.full((480, 640), np.nan, np.float32))
    with pytest.raises(CalibrationValue, match="0 pixels are matched"):
        seen_scale(KnownDistance.parse("box:300,200,340,240=2"), plan, nothing)
    with pytest.raises(CalibrationValue, match="outside"):
        seen_scale(KnownDistance.parse("box:300,200,3400,240=2"), plan, nothing)


def test_pixels_of_a_known_distance_are_those_of_the_picture_as_it_was_taken():
    """Rectified, the left picture is turned by 8 degrees: 60 px at this focal length."""
    K = np.array([[420.0, 0, 319.5], [0, 420, 239.5], [0, 0, 1]])
    eyes = Camera(K, 640, 480), Camera(K, 640, 480, frame="camera_right")
    T_right_left = np.eye(4)
    T_right_left[:3, :3] = turn((0.0, 16.0, 0.0))
    T_right_left[:3, 3] = turn((0.0, 8.0, 0.0)) @ np.array([-0.2, 0.0, 0.0])
    plan = rectification(StereoRig(*eyes, Pose("camera_right", "camera_left", T_right_left)))
    u, v = 300.0, 200.0
    flat = plan.rig.left.K @ plan.R_left @ np.linalg.inv(K) @ np.array([u, v, 1.0])
    column = flat[0] / flat[2]
    ramp = np.tile(5 + 0.1 * np.arange(640, dtype=np.float32), (480, 1))
    known = KnownDistance.parse(f"box:{u - 4},{v - 4},{u + 4},{v + 4}=3")
    scale = seen_scale(known, plan, DisparityMap(ramp))
    assert abs(column - u) > 30
    assert scale.metres == pytest.approx(3 * (5 + 0.1 * column) / plan.rig.fB_px_m, rel=0.02)
