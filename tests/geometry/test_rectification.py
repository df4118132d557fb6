from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.errors import CalibrationValue, UsageError
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import (
    Rectification,
    aligning_rotations,
    rectification,
    turned,
)
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.pose import Pose
from tests.raw_rigs import PLACE_M, raw_rig


def opencvs(rig: StereoRig, alpha: float, size: tuple[int, int]) -> tuple[np.ndarray, ...]:
    R, t = rig.T_right_left.matrix[:3, :3], rig.T_right_left.translation_m
    return cv2.stereoRectify(
        rig.left.K,
        rig.left.distortion,
        rig.right.K,
        rig.right.distortion,
        rig.left.size_px,
        R,
        t[:, None],
        flags=cv2.STEREO_ZERO_DISPARITY,
        alpha=alpha,
        newImageSize=size,
    )[:4]


# OpenCV takes five steps from a pixel to its direction: with little distortion that is enough.
@pytest.mark.parametrize(("strength", "within_px"), [(0.0, 5e-5), (0.3, 1e-3), (1.0, 0.5)])
@pytest.mark.parametrize("coefficients", [5, 8, 12])
def test_pinhole_rigs_become_what_opencv_makes_of_them(
    strength: float, within_px: float, coefficients: int
):
    rig = raw_rig(coefficients, strength=strength)
    for alpha in (0.0, 0.4, 1.0):
        R_left, R_right, P_left, P_right = opencvs(rig, alpha, (640, 480))
        got = rectification(rig, alpha=alpha)
        np.testing.assert_allclose(got.R_left, R_left, atol=1e-12)
        np.testing.assert_allclose(got.R_right, R_right, atol=1e-12)
        np.testing.assert_allclose(got.rig.P_left, P_left, atol=within_px)
        np.testing.assert_allclose(got.rig.P_right, P_right, atol=within_px)


def raw_points(planned: Rectification, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points in the rectified left camera's frame, and in the left one's as it is."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((-1.5, -1.0, 2.0), (1.5, 1.0, 6.0), (300, 3))
    return points, points @ planned.R_left


@pytest.mark.parametrize(
    "rig",
    [
        raw_rig(5),
        raw_rig(12, right_px=(1280, 960)),
        raw_rig(8, right_px=(320, 240)),
        raw_rig(model="fisheye"),
        raw_rig(model="fisheye", right_px=(800, 600)),
        replace(raw_rig(model="fisheye"), right=raw_rig(5, right_px=(960, 720)).right),
    ],
    ids=("pinhole", "larger right", "smaller right", "fisheye", "larger fisheye", "two lenses"),
)
def test_what_both_eyes_see_lies_in_one_row_at_the_disparity_of_its_depth(rig: StereoRig):
    planned = rectification(rig)
    points, in_left = raw_points(planned)
    in_right = rig.T_right_left.apply(in_left)
    rows, columns = [], []
    for camera, R, seen in (
        (rig.left, planned.R_left, in_left),
        (rig.right, planned.R_right, in_right),
    ):
        lens = Lens.of(camera)
        uv, holds = lens.pixels(seen)
        assert holds.all()
        straight = lens.directions(uv) @ R.T  # from the pixel alone, as a map goes back
        flat = straight[:, :2] / straight[:, 2:]
        K = planned.rig.left.K
        columns.append(K[0, 0] * flat[:, 0] + K[0, 2])
        rows.append(K[1, 1] * flat[:, 1] + K[1, 2])
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-6)
    disparity = columns[0] - columns[1]
    np.testing.assert_allclose(planned.rig.fB_px_m / disparity, points[:, 2], rtol=1e-8)
    assert planned.rig.is_rectified
    assert planned.rig.baseline_m == pytest.approx(np.linalg.norm(PLACE_M))


def test_zoom_and_size_change_what_they_say():
    rig = raw_rig(5)
    plain, near = rectification(rig), rectification(rig, zoom=1.5)
    assert near.rig.left.focal_px == pytest.approx(1.5 * plain.rig.left.focal_px)
    twice = rectification(rig, size_px=(1280, 960)).rig.left
    assert twice.size_px == (1280, 960)
    assert twice.focal_px == pytest.approx(2 * plain.rig.left.focal_px, rel=2e-3)
    # OpenCV moves the centre twice as far and has to zoom in, to keep black edges out.
    assert opencvs(rig, 0.0, (1280, 960))[2][0, 0] > 1.05 * twice.focal_px
    wide = rectification(rig, alpha=1.0)
    assert wide.rig.left.focal_px < plain.rig.left.focal_px


@pytest.mark.parametrize("wider", ["left", "right"])
def test_alpha_1_keeps_all_of_both_pictures_and_alpha_0_shows_no_black(wider: str):
    """Whichever eye sees more: the first is up to it, the second to the other one."""
    rig = raw_rig(5)
    eye = getattr(rig, wider)
    K = eye.K.copy()
    K[[0, 1], [0, 1]] *= 0.8
    rig = replace(rig, **{wider: replace(eye, K=K)})
    for alpha in (0.0, 1.0):
        planned = rectification(rig, alpha=alpha)
        flat = planned.rig.left
        edges = {}
        for name, camera, R in (
            ("left", rig.left, planned.R_left),
            ("right", rig.right, planned.R_right),
        ):
            # (4 sides, N) places: of the raw picture's outline, in the rectified one for alpha 1;
            # of the rectified picture's outline, in the raw one for alpha 0.
            if alpha == 1:
                directions = Lens.of(camera).directions(outline(camera.size_px)) @ R.T
                seen, held_by = directions[:, :2] / directions[:, 2:] @ flat.K[:2, :2].T, flat
                seen = seen + flat.K[:2, 2]
            else:
                rays = np.column_stack([outline(flat.size_px), np.ones(400)])
                seen, _ = Lens.of(camera).pixels(rays @ np.linalg.inv(flat.K).T @ R)
                held_by = camera
            width, height = held_by.size_px
            room = np.concatenate([seen, (width - 1, height - 1) - seen], axis=1)
            edges[name] = room.min()
        assert min(edges.values()) == pytest.approx(0, abs=1.5)
        assert (edges[wider] < edges["right" if wider == "left" else "left"]) == (alpha == 1)


def outline(size_px: tuple[int, int]) -> np.ndarray:
    """(400, 2) pixels along the four sides of a picture."""
    width, height = size_px
    x, y = np.linspace(0, width - 1, 100), np.linspace(0, height - 1, 100)
    sides = (x, 0 * x), (x, 0 * x + height - 1), (0 * y, y), (0 * y + width - 1, y)
    return np.concatenate([np.stack(side, axis=1) for side in sides])


def test_a_fisheye_is_cut_at_the_field_that_is_asked_for():
    rig = raw_rig(model="fisheye", focal_px=200.0)  # 640 px hold 180 degrees
    for field_deg in (90.0, 120.0):
        camera = rectification(rig, field_deg=field_deg).rig.left
        half = np.tan(np.deg2rad(field_deg / 2))
        left, right = camera.K[0, 2] / camera.focal_px, (639 - camera.K[0, 2]) / camera.focal_px
        assert max(left, right) <= half * 1.001
        assert max(left, right) > 0.9 * half


def test_other_sensors_stay_where_they_are():
    matrix = np.eye(4)
    matrix[:3, 3] = 0.1, -0.3, 0.2
    lidar = Pose("camera_left", "velodyne", matrix)
    planned = rectification(replace(raw_rig(5), T_left_velodyne=lidar))
    point = np.array([[1.0, 2.0, 3.0]])
    got = planned.rig.T_left_velodyne.apply(point)
    np.testing.assert_allclose(got, lidar.apply(point) @ planned.R_left.T, atol=1e-12)


def test_given_rotations_are_taken_as_they_are():
    rig = raw_rig(5)
    R_left, R_right, P_left, P_right = opencvs(rig, 0.0, (640, 480))
    planned = turned(rig, R_left, R_right, P_left[:, :3], (640, 480))
    np.testing.assert_allclose(planned.rig.P_right, P_right, atol=1e-9)


def test_a_rectified_rig_stays_as_it_is():
    rig = rectification(raw_rig(5), alpha=0.3).rig
    again = rectification(rig)
    np.testing.assert_allclose(again.R_left, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(again.rig.P_right, rig.P_right, rtol=5e-3)


@pytest.mark.parametrize(
    ("place_m", "words"),
    [
        ((0.0, -0.2, 0.0), "above each other"),
        ((0.02, 0.0, 0.2), "behind each other"),
        ((-0.09, -0.18, 0.0), "above each other"),  # 63 degrees off the rows
        ((0.2, 0.0, 0.0), "stands right of the other"),
    ],
)
def test_cameras_that_do_not_stand_side_by_side(place_m: tuple[float, ...], words: str):
    with pytest.raises(CalibrationValue, match=words):
        rectification(raw_rig(5, place_m=np.array(place_m)))


def test_cameras_56_degrees_off_the_rows_are_still_side_by_side():
    raw = raw_rig(0, place_m=np.array((-0.12, -0.18, 0.0)))
    R_left, R_right = aligning_rotations(raw.T_right_left)
    np.testing.assert_allclose(R_right @ raw.T_right_left.matrix[:3, :3], R_left, atol=1e-12)
    t_m = R_right @ raw.T_right_left.translation_m
    np.testing.assert_allclose(t_m, [-np.hypot(0.12, 0.18), 0, 0], atol=1e-12)


def test_cameras_that_look_apart():
    with pytest.raises(CalibrationValue, match="look in such different directions"):
        rectification(raw_rig(5, turn=np.array([1.6, 0.0, 0.0])))


@pytest.mark.parametrize(
    "wrong",
    [
        {"alpha": 1.2},
        {"alpha": float("nan")},
        {"zoom": 0},
        {"field_deg": 180},
        {"size_px": (8, 8)},
    ],
)
def test_numbers_that_make_no_picture(wrong: dict[str, float]):
    with pytest.raises(UsageError):
        rectification(raw_rig(5), **wrong)


def test_pictures_of_pinhole_lenses_are_never_cut_at_a_field() -> None:
    rig = raw_rig(5, focal_px=130.0, strength=0.0)
    wide, narrow = (rectification(rig, field_deg=field) for field in (170.0, 60.0))
    np.testing.assert_array_equal(wide.rig.left.K, narrow.rig.left.K)
