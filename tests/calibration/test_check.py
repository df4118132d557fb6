"""The calibration doctor on pairs with known mistakes, and on pairs that say nothing."""

import math
import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.check import check_pair, combined, stopping
from pseudolidar.calibration.check_epipolar import fit_rows
from pseudolidar.calibration.check_exposure import gain_offset
from pseudolidar.calibration.check_eyes import eyes_found
from pseudolidar.calibration.check_finding import SUREST, Finding, percent, sure_beyond
from pseudolidar.calibration.check_matches import match_points
from pseudolidar.calibration.check_rig import baseline_found, focal_found
from pseudolidar.errors import NotRectified, PairSwapped
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from tests.exposed import exposed
from tests.perturbed import ROWS_OFF, right_moved, swapped, warped

WORLDS = ("street", "room", "flight")
WIDTH_PX = 800


@pytest.fixture(scope="module")
def worlds():
    """A pair of each rendered world."""
    return {name: Synthetic(name, width_px=WIDTH_PX).open().load(0) for name in WORLDS}


@pytest.fixture(scope="module")
def drive():
    """Three pairs of the street, a tenth of a second apart."""
    source = Synthetic("street", width_px=WIDTH_PX, frames=3).open()
    return [source.load(index) for index in range(3)]


def found(frame, **around):
    return {finding.name: finding for finding in check_pair(frame, **around).findings}


def severities(frame, **around):
    return {name: finding.severity for name, finding in found(frame, **around).items()}


def pictures(left, right=None):
    """A frame of any two pictures, with a rig of their size."""
    height, width = left.shape[:2]
    K = np.array([[700.0, 0, width / 2], [0, 700.0, height / 2], [0, 0, 1.0]])
    rig = StereoRig(
        Camera(K, width, height),
        Camera(K, width, height, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.5, 0.0, 0.0])),
    )
    return StereoFrame(left, left.copy() if right is None else right, rig, "0", 0, 0)


@pytest.mark.parametrize("world", WORLDS)
def test_what_is_right_is_called_right(worlds, world):
    frame = worlds[world]
    seen = found(frame)
    unsound = [f.line for f in seen.values() if f.severity in ("stop", "warn", "note")]
    assert unsound == []
    assert {seen[name].severity for name in ("eyes", "rows", "ground truth")} == {"good"}
    assert seen["rows"].figures["typical_px"] < 0.1
    assert seen["eyes"].sure == SUREST


@pytest.mark.parametrize("world", WORLDS)
def test_swapped_eyes_stop_with_the_flag_that_mends_them(worlds, world):
    check = check_pair(swapped(worlds[world]))
    error = stopping(check.findings)
    assert isinstance(error, PairSwapped)
    assert error.fix == "Pass --swap."
    assert "swapped" in error.got
    assert "% sure" in error.got


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("how", ROWS_OFF)
def test_rows_that_are_off_stop_with_what_they_are_off_by(worlds, world, how):
    seen = found(ROWS_OFF[how](worlds[world]))
    assert seen["rows"].severity == "stop", seen["rows"].line
    assert seen["rows"].sure > 0.99
    amount = float(how.split()[0]) if how[0] in "-0123456789" else 0.5
    figures = seen["rows"].figures
    if how.endswith("px"):
        assert figures["offset_px"] == pytest.approx(amount, abs=0.15)
        assert f"{abs(amount):.1f} px {'lower' if amount > 0 else 'higher'}" in seen["rows"].text
    else:
        # cv2 turns anticlockwise, and the left eye the other way round.
        turned = -amount if not how.startswith("left") else amount
        assert figures["roll_deg"] == pytest.approx(turned, abs=0.06)
        assert "rolled" in seen["rows"].text
    assert isinstance(stopping(tuple(seen.values())), NotRectified)


def test_both_mistakes_at_once_are_both_seen(worlds):
    seen = found(swapped(right_moved(worlds["street"], down_px=3)))
    assert (seen["eyes"].severity, seen["rows"].severity) == ("stop", "stop")


def test_rows_off_by_what_rectification_leaves_are_no_mistake(worlds):
    for off_px in (-0.5, 0.3, 0.5):
        assert found(right_moved(worlds["street"], down_px=off_px))["rows"].severity == "good"
    assert found(right_moved(worlds["street"], down_px=0.8))["rows"].severity == "warn"


def noisy(image, sigma, seed=0):
    noise = np.random.default_rng(seed).normal(0, sigma, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def unclear_pairs(street):
    width, height = 640, 360
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    board = ((x // 20 + y // 20) % 2 * 180 + 40).astype(np.float64)
    fence = (np.sin(x / 5) > 0) * 150.0 + 50 + (y > 180) * 30
    even = np.full((height, width), 128.0)
    return {
        "night": (noisy(street.left * 0.02, 1.5, 1), noisy(street.right * 0.02, 1.5, 2)),
        "swapped night": (noisy(street.right * 0.02, 1.5, 1), noisy(street.left * 0.02, 1.5, 2)),
        "chessboard": (noisy(board, 3, 1), noisy(np.roll(board, -7, 1), 3, 2)),
        "fence": (noisy(fence, 3, 1), noisy(np.roll(fence, -4, 1), 3, 2)),
        "wall": (noisy(even, 3, 1), noisy(even, 3, 2)),
        "smooth wall": (noisy(x * 0.3, 1, 1), noisy(x * 0.3, 1, 2)),
        "two scenes": (street.left, noisy(street.left[:, ::-1], 2, 2)),
    }


@pytest.mark.parametrize("name", unclear_pairs(pictures(np.zeros((360, 640, 3), np.uint8))))
def test_what_cannot_be_told_is_not_guessed(worlds, name):
    seen = found(pictures(*unclear_pairs(worlds["street"])[name]))
    assert {seen[what].severity for what in ("eyes", "rows", "sync")} == {"unknown"}, seen
    assert all(f.severity in ("good", "unknown") for f in seen.values())
    assert "cannot tell" in seen["rows"].text
    assert stopping(tuple(seen.values())) is None


def test_far_scenes_do_not_tell_the_eyes_apart():
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (360, 640)), (0, 0), 2)
    texture = cv2.normalize(texture, None, 20, 235, cv2.NORM_MINMAX)
    near = (texture + np.roll(texture, -1, 1)) / 2  # half a pixel
    seen = found(pictures(noisy(texture, 4, 1), noisy(near, 4, 2)))
    assert seen["eyes"].severity == "unknown"
    assert seen["rows"].severity == "good"


def test_the_same_picture_twice_is_seen_even_if_it_was_stored_anew(worlds):
    left = worlds["street"].left
    again = cv2.imdecode(cv2.imencode(".jpg", left, [cv2.IMWRITE_JPEG_QUALITY, 85])[1], 1)
    for right in (left.copy(), again):
        seen = severities(pictures(left, right))
        assert seen["same picture"] == "warn"
        assert (seen["eyes"], seen["rows"]) == ("note", "note")


def test_principal_points_of_other_pictures_are_warned_of(worlds):
    """Cropped on one side only: far things lie behind infinity, near ones before it."""
    frame = worlds["street"]
    moved = replace(frame, right=np.roll(frame.right, 9, axis=1), truth=None)
    eyes = found(moved)["eyes"]
    assert (eyes.severity, "principal points" in eyes.text) == ("warn", True)


@pytest.mark.parametrize(
    ("gains", "offset", "seen"),
    [((1, 1, 1), 0, "good"), ((0.7, 0.7, 0.7), 0, "warn"), ((1.0, 0.85, 0.85), 0, "warn")],
)
def test_exposure_and_white_balance(worlds, gains, offset, seen):
    frame = worlds["room"]
    right = np.clip(frame.right * np.array(gains) + offset, 0, 255).astype(np.uint8)
    exposure = found(replace(frame, right=right))["exposure"]
    assert exposure.severity == seen
    for name, gain in zip(("red", "green", "blue"), gains, strict=True):
        assert exposure.figures[f"ratio_{name}"] == pytest.approx(gain, abs=0.05)
    assert exposure.figures["gamma"] == pytest.approx(1.0, abs=0.05)
    assert exposure.figures["vignetting"] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("difference", "said"),
    [
        ({"gamma": 1.4}, "its curve has 1.3"),
        ({"vignetting": -0.5}, "% darker"),
    ],
)
def test_another_curve_and_darker_corners(worlds, difference, said):
    frame = worlds["room"]
    exposure = found(replace(frame, right=exposed(frame.right, **difference)))["exposure"]
    assert exposure.severity == "warn"
    assert said in exposure.text
    assert exposure.figures["gamma"] == pytest.approx(difference.get("gamma", 1.0), abs=0.08)
    corners = np.expm1(difference.get("vignetting", 0.0))
    assert exposure.figures["vignetting"] == pytest.approx(corners, abs=0.06)


def test_gain_and_offset_are_those_that_were_put_on():
    rng = np.random.default_rng(0)
    left = rng.uniform(20, 180, 500)
    right = 1.2 * left + 10 + rng.normal(0, 2, 500)
    right[:50] = rng.uniform(0, 255, 50)
    gain, offset = gain_offset(left, right)
    assert gain == pytest.approx(1.2, abs=0.02)
    assert offset == pytest.approx(10, abs=2)


def test_a_baseline_in_millimetres_is_asked_about(worlds):
    frame = worlds["street"]
    rig = frame.rig
    t_mm = rig.T_right_left.translation_m * 1000
    wrong = replace(
        rig, T_right_left=Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_mm)
    )
    finding = baseline_found(wrong, match_points(frame.left, frame.right).disparity_px)
    assert (finding.severity, "millimetres?" in finding.text) == ("warn", True)
    assert "--rig-unit mm" in finding.mend
    twice = replace(
        rig, T_right_left=Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_mm / 1e6)
    )
    finding = baseline_found(twice, match_points(frame.left, frame.right).disparity_px)
    assert (finding.severity, "times 1000" in finding.text) == ("warn", True)


def test_the_focal_length_of_the_wrong_matrix(worlds):
    rig = worlds["street"].rig

    def with_focal(fx, fy):
        K = rig.left.K.copy()
        K[0, 0], K[1, 1] = fx, fy
        return replace(rig, left=replace(rig.left, K=K), right=replace(rig.right, K=K))

    f = rig.left.focal_px
    assert focal_found(rig, None).severity == "good"
    assert focal_found(with_focal(f * 1.005, f * 1.005), rig).severity == "good"
    other = focal_found(with_focal(1.33 * f, 1.33 * f), rig)
    assert (other.severity, f"{f:.1f}" in other.text) == ("warn", True)
    # 0.3 %: the own matrices of KITTI's cameras; 1e-4: rounded by resizing.
    assert focal_found(with_focal(1.003 * f, f), None).severity == "warn"
    assert focal_found(with_focal(1.0001 * f, f), None).severity == "good"
    assert focal_found(with_focal(40 * f, 40 * f), None).severity == "warn"
    assert focal_found(with_focal(2 * f, f), None).severity == "note"  # squeezed pictures
    width, height = rig.left.size_px
    mistaken = focal_found(with_focal(f, f * height / width), None)
    assert mistaken.severity == "warn"
    assert "no lens makes" in mistaken.text


@pytest.mark.parametrize("factor", [1.0, 16.0, 256.0, 1 / 16, 1 / 256, 3.0])
def test_truth_in_another_scale(worlds, factor):
    frame = worlds["street"]
    truth = DisparityMap((frame.truth.values * factor).astype(np.float32))
    finding = found(replace(frame, truth=truth))["ground truth"]
    assert finding.severity == ("good" if factor == 1 else "warn")
    stored = {16.0: "x 16", 256.0: "x 256", 1 / 16: "/ 16", 1 / 256: "/ 256"}.get(factor, "")
    assert stored in finding.text
    assert ("stored" in finding.text) == bool(stored)


def test_a_frame_too_late_is_told_from_rows_that_are_off(drive):
    """The right picture is that of the frame after."""
    late = replace(drive[1], right=drive[2].right)
    alone = check_pair(late)
    assert alone.suspicious
    seen = found(late, before=drive[1].right)
    assert (seen["sync"].severity, "a frame too late" in seen["sync"].text) == ("warn", True)
    assert seen["rows"].severity == seen["eyes"].severity == "note"
    early = found(replace(drive[1], right=drive[0].right), after=drive[1].right)
    assert "a frame too early" in early["sync"].text


def test_in_step_is_only_said_of_a_rig_that_moves(drive):
    moving = found(drive[1], before=drive[0].right, after=drive[2].right)["sync"]
    assert (moving.severity, "in step" in moving.text) == ("good", True)
    still = found(drive[1], before=drive[1].right, after=drive[1].right)["sync"]
    assert (still.severity, "does not move" in still.text) == ("unknown", True)
    assert found(drive[1])["sync"].severity == "unknown"


def test_a_roll_is_a_roll_however_the_frames_around_look(drive):
    rolled = [right_moved(frame, roll_deg=0.5) for frame in drive]
    seen = found(rolled[1], before=rolled[0].right, after=rolled[2].right)
    assert (seen["rows"].severity, seen["sync"].severity) == ("stop", "good")


def test_most_of_the_pairs_must_agree_before_a_run_is_stopped(drive):
    good, bad = check_pair(drive[0]), check_pair(right_moved(drive[1], down_px=3))
    unclear = check_pair(
        pictures(noisy(np.full((360, 640), 128.0), 3), noisy(np.zeros((360, 640)), 3))
    )

    def rows(*checks):
        return next(f for f in combined(checks) if f.name == "rows")

    assert rows(good, bad, bad).severity == "stop"
    assert rows(good, good, bad).severity == "warn"
    assert bad.id in rows(good, good, bad).text
    assert rows(unclear, bad, unclear).severity == "stop"
    assert rows(unclear, good, unclear).severity == "good"
    assert rows(unclear, unclear).severity == "unknown"


def test_large_and_deep_pictures_are_judged_in_their_own_pixels(worlds):
    frame = worlds["street"]
    size = (frame.size_px[0] * 2, frame.size_px[1] * 2)
    left, right = (
        cv2.resize(eye, size).astype(np.uint16) * 200 for eye in (frame.left, frame.right)
    )
    wide = pictures(left, warped(right, down_px=3))
    seen = found(wide)["rows"]
    assert seen.severity == "stop"
    assert seen.figures["offset_px"] == pytest.approx(3, abs=0.3)


def test_a_tilted_baseline_is_named(worlds):
    """Both eyes rolled by 12 degrees against the line on which they stand."""
    frame = worlds["room"]
    rolled = replace(
        frame,
        left=warped(frame.left, roll_deg=12.0),
        right=warped(frame.right, roll_deg=12.0),
        truth=None,
    )
    rows = found(rolled)["rows"]
    assert (rows.severity, "side by side" in rows.text) == ("stop", True)
    fit = fit_rows(match_points(rolled.left, rolled.right), frame.rig, direction=True)
    assert abs(fit.direction[0]) == pytest.approx(math.tan(math.radians(12.0)), abs=0.01)


def test_the_same_pair_gives_the_same_findings_and_travels(worlds):
    frame = right_moved(worlds["room"], down_px=2)
    first, second = check_pair(frame), check_pair(frame)
    assert first.findings == second.findings
    again = pickle.loads(pickle.dumps(first))
    assert [f.as_dict() for f in again.findings] == [f.as_dict() for f in first.findings]


def test_how_sure_it_is():
    assert percent(0.9999) == "99.9 %"
    assert percent(0.5) == "50 %"
    assert sure_beyond(1.0, 1.0, 0.1) == pytest.approx(0.5)
    assert sure_beyond(2.0, 1.0, 0.1) == SUREST
    line = Finding("rows", "stop", "off", 0.987, "Mend it.").line
    assert line == "rows: off (98.7 % sure). Mend it."


@pytest.mark.parametrize(("behind", "of", "severity"), [(3, 45, "good"), (12, 180, "warn")])
def test_it_takes_more_than_a_clump_to_doubt_the_rig(behind: int, of: int, severity: str) -> None:
    """Squares of a board are taken for one another, which says nothing of principal points."""
    disparity_px = np.full(of, 20.0)
    disparity_px[:behind] = -15.0
    assert eyes_found(disparity_px, 0.0).severity == severity
