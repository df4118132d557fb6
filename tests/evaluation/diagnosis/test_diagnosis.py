"""Rigs with one thing wrong, and with several: each is found by name and size."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.evaluation.compared import ComparedFrame, against_truth
from pseudolidar.evaluation.diagnosis.blocks import ErrorBlocks, error_blocks
from pseudolidar.evaluation.diagnosis.causes import CAUSES, Seen
from pseudolidar.evaluation.diagnosis.diagnosis import diagnose
from pseudolidar.evaluation.diagnosis.timing import time_offset
from pseudolidar.geometry.triangulation import depth_from_disparity, disparity_from_depth
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose

SIZES = {
    "scale": 1.5,
    "offset": 0.4,
    "yaw": -0.1,
    "tilt": 1.0,
    "focal_ratio": 0.2,
    "lidar_forward": 0.15,
    "lidar_yaw": 0.4,
    "lidar_pitch": -0.4,
}


def rig() -> StereoRig:
    K = np.array([[720.0, 0, 610.0], [0, 720.0, 173.0], [0, 0, 1]])
    left, right = Camera(K, 1242, 375), Camera(K, 1242, 375, frame="camera_right")
    apart = Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.54, 0, 0]))
    return StereoRig(left, right, apart)


def compared(wrong=None, *, frames=6, noise_px=0.4, seed=0) -> list[ComparedFrame]:
    """Points of slanted surfaces all over the image; `wrong` is sizes of causes by name."""
    rng = np.random.default_rng(seed)
    found = []
    for index in range(frames):
        n = 12_000
        u, v = rng.uniform(0, 1241, n), rng.uniform(100, 374, n)
        true_px = np.exp(rng.uniform(np.log(4), np.log(80), n))
        # walls along the street, and the road: every block of the image has slopes of its own
        slope = np.stack([0.15 * np.sin(u // 155.25), 0.15 * np.cos(2 * (v // 93.75))], axis=1)
        blocks = ErrorBlocks(u, v, true_px, 0 * u, 1 + 0 * u, *slope.T, 0 * u.astype(np.int64))
        seen = Seen.of(blocks, rig())
        error = rng.normal(0, noise_px, n)
        for cause in CAUSES:
            error += (wrong or {}).get(cause.name, 0.0) * cause.pattern(seen)
        error[rng.random(n) < 0.05] += 15.0  # wrong matches
        depth_m = depth_from_disparity(true_px, u, rig())
        found.append(
            ComparedFrame(
                str(index), index, index, rig(), u, v, depth_m, true_px + error, None, slope
            )
        )
    return found


@pytest.mark.parametrize("name", SIZES)
def test_each_cause_alone_is_found_by_name_and_size(name):
    diagnosis = diagnose(compared({name: SIZES[name]}))
    named = {e.names[0]: e.causes[0] for e in (diagnosis.chosen, *diagnosis.alternatives)}
    assert diagnosis.chosen.names == (name,) or name in named
    assert named[name].size == pytest.approx(SIZES[name], rel=0.1)
    assert abs(named[name].size - SIZES[name]) < 3 * named[name].sigma
    assert diagnosis.unexplained_px < 0.5 * diagnosis.systematic_px


def test_a_healthy_rig_has_no_cause():
    diagnosis = diagnose(compared())
    assert diagnosis.chosen.causes == ()
    assert "healthy" in diagnosis.text()


def test_two_causes_at_once():
    diagnosis = diagnose(compared({"scale": 2.0, "tilt": 1.0}))
    assert set(diagnosis.chosen.names) == {"scale", "tilt"}
    by_name = {found.cause.name: found.size for found in diagnosis.chosen.causes}
    assert by_name == pytest.approx({"scale": 2.0, "tilt": 1.0}, rel=0.1)


def test_what_looks_alike_is_named():
    """A small turn and an offset differ by hundredths of a pixel in this image."""
    diagnosis = diagnose(compared({"offset": 0.2}))
    others = {name for e in diagnosis.alternatives for name in e.names}
    twins = {name for found in diagnosis.chosen.causes for name in found.twins}
    assert {*diagnosis.chosen.names, *others} >= {"offset", "yaw"}
    assert twins & {"yaw", "offset"}
    assert "not told apart from" in diagnosis.text()


def test_causes_that_cancel_are_told_as_a_sum_and_not_as_facts():
    """A wrong principal point that a wrong rotation makes up for, as calibrations have them."""
    frames = compared({"offset": 1.25, "yaw": -0.11}, noise_px=0.2)
    diagnosis = diagnose(frames)
    pair = diagnosis.chosen
    assert pair.names == ("offset", "yaw")
    assert pair.effect.cancels
    assert pair.effect.alone_px > 3 * pair.effect.together_px
    # what is left bends: 1.25 - 1.38 (1 + x^2)
    assert pair.effect.middle_px == pytest.approx(-0.15, abs=0.05)
    assert pair.effect.sides_px == pytest.approx(-0.9, abs=0.1)
    assert "fits a sum, of" in diagnosis.text()
    assert "none of them is found for itself" in diagnosis.text()
    assert "explained by" not in diagnosis.text()
    added = diagnose(compared({"offset": -0.3, "yaw": -0.1})).chosen
    assert not added.effect.cancels


def test_what_no_cause_explains_is_said():
    """Bands that no cause makes, as of a matcher or a lens."""
    frames = [
        replace(frame, disparity_px=frame.disparity_px + 0.8 * np.sin(frame.u / 60))
        for frame in compared({"scale": 1.0})
    ]
    diagnosis = diagnose(frames)
    assert diagnosis.mostly_unknown
    assert "most of it has another form" in diagnosis.text()
    assert not diagnose(compared({"scale": 2.0})).mostly_unknown


def test_the_bias_of_each_range_is_explained():
    shares = diagnose(compared({"scale": 2.0})).bias
    known = [share for share in shares if share.bias_rel is not None and share.to_m <= 50]
    assert known
    for share in known:
        assert share.explained_rel == pytest.approx(0.02, abs=0.003)
        assert share.bias_rel == pytest.approx(0.02, abs=0.006)


def test_one_frame_is_judged_by_its_columns_and_too_few_points_not_at_all():
    assert diagnose(compared({"scale": 3.0}, frames=1)).chosen.names == ("scale",)
    few = [replace(c, disparity_px=np.full(len(c), np.nan)) for c in compared(frames=2)]
    assert len(error_blocks(few)) == 0
    assert diagnose(few) is None


def test_the_same_frames_give_the_same_diagnosis():
    frames = compared({"yaw": 0.1, "scale": 1.0})
    assert diagnose(frames).as_dict() == diagnose(frames).as_dict()


@pytest.mark.parametrize("late_s", [0.02, -0.015])
def test_late_scans_are_nearer_the_faster_one_drives(late_s):
    speeds = np.array([2.0, 5.0, 9.0, 12.0, 15.0, 7.0])
    frames = [
        compared({"lidar_forward": -speed * late_s}, frames=1, seed=i)[0]
        for i, speed in enumerate(speeds)
    ]
    found = time_offset(frames, speeds)
    assert found.late_s == pytest.approx(late_s, abs=max(0.003, 3 * found.sigma_s))
    assert ("after" if late_s > 0 else "before") in found.text


def test_time_offsets_that_cannot_be_told():
    frames = compared()
    steady = time_offset(frames, np.full(6, 8.0))
    assert steady.late_s is None
    assert "speeds differ by 0.00 m/s" in steady.text
    assert "speeds of 0 frames" in time_offset(frames, np.full(6, np.nan)).reason


# --- rendered pairs, a real matcher -------------------------------------------------------------


def longer_baseline(frame, share):
    pose = frame.rig.T_right_left
    matrix = pose.matrix.copy()
    matrix[:3, 3] *= 1 + share
    return replace(frame, rig=replace(frame.rig, T_right_left=Pose(pose.dst, pose.src, matrix)))


def shifted_centre(frame, offset_px):
    K = frame.rig.right.K.copy()
    K[0, 2] += offset_px
    rig = replace(frame.rig, right=replace(frame.rig.right, K=K))
    return replace(frame, rig=rig, truth=None)


def turned_right_camera(frame, outwards_deg):
    K, turn = frame.rig.right.K, np.radians(outwards_deg)
    R = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    right = cv2.warpPerspective(
        frame.right,
        K @ R @ np.linalg.inv(K),
        frame.size_px,
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return replace(frame, right=right)


def with_truth_of(frame, wrong):
    """The wrong frame with the true depth, as disparity of its wrong rig."""
    height, width = frame.truth.values.shape
    u = np.broadcast_to(np.arange(width, dtype=np.float64), (height, width))
    depth_m = depth_from_disparity(frame.truth.values.astype(np.float64), u, frame.rig)
    true_px = disparity_from_depth(depth_m, u, wrong.rig).astype(np.float32)
    return replace(wrong, truth=DisparityMap(true_px))


@pytest.fixture(scope="module")
def street():
    source = Synthetic("street", frames=4).open()
    return [source.load(index) for index in range(4)]


@pytest.mark.parametrize(
    ("perturb", "size", "name", "expected"),
    [
        (longer_baseline, 0.01, "scale", 1.0),
        (shifted_centre, 0.3, "offset", 0.3),
        (turned_right_camera, 0.1, "yaw", 0.1),
    ],
)
def test_a_rig_of_a_rendered_street_that_is_wrong(perturb, size, name, expected, street):
    match = Census(quality="fine").load()
    frames = []
    for frame in street:
        wrong = with_truth_of(frame, perturb(frame, size))
        frames.append(against_truth(match(wrong), wrong, most=60_000))
    diagnosis = diagnose(frames)
    found = {e.names: e for e in (diagnosis.chosen, *diagnosis.alternatives)}
    assert (name,) in found
    assert found[(name,)].causes[0].size == pytest.approx(expected, rel=0.15)
    assert diagnosis.unexplained_px < 0.1
