import cv2
import numpy as np
import pytest

from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.find import find_board
from pseudolidar.calibration.boards.markers import dictionary_of
from pseudolidar.calibration.boards.refine import on_grid
from pseudolidar.geometry.lens import Lens
from tests.boards import board, fisheye_rig, picture, pinhole_rig, poses

# Largest median and largest error of any corner, px. Circles are seen as ellipses, whose middles
# are not the circles' middles. Squares of the ChArUco board are 15 px wide in the fisheye, and
# markers come within 2 px of a corner.
CHESS, MARKERS, CIRCLES = (0.03, 0.1), (0.06, 1.2), (0.2, 0.3)


def errors(found: Corners, made, uv: np.ndarray) -> np.ndarray:
    """Of the corners, read the way that fits best."""
    off = [np.linalg.norm(found.uv - uv[turn][found.ids], axis=1) for turn in made.turns()]
    return min(off, key=np.median)


@pytest.mark.parametrize(
    ("text", "square_m", "limits", "least"),
    [
        ("chessboard:9x6", 0.03, CHESS, 54),
        ("charuco:8x6", 0.03, MARKERS, 33),
        ("circles:7x6", 0.03, CIRCLES, 42),
        ("acircles:4x11", 0.015, CIRCLES, 44),
        ("aprilgrid:3x2", 0.06, MARKERS, 12),
    ],
)
@pytest.mark.parametrize("rig", [pinhole_rig(), fisheye_rig()], ids=["pinhole", "fisheye"])
def test_corners_are_found_where_they_are(text, square_m, limits, least, rig):
    made = board(text, square_m)
    T = poses(made, 1, seed=3, near=1.8 if rig.left.model == "pinhole" else 0.9, spread=0.3)[0]
    found = find_board(picture(rig.left, made, T), made)
    assert found is not None
    assert len(found) >= least
    uv, _ = Lens.of(rig.left).pixels(made.points_m @ T[:3, :3].T + T[:3, 3])
    off = errors(found, made, uv)
    assert np.median(off) < limits[0]
    assert off.max() < limits[1]


def test_a_part_of_a_charuco_board_is_read_right():
    made, rig = board("charuco:8x6"), pinhole_rig()
    T = poses(made, 1, seed=3)[0]
    seen = picture(rig.left, made, T)
    uv, _ = Lens.of(rig.left).pixels(made.points_m @ T[:3, :3].T + T[:3, 3])
    seen[:, int(np.median(uv[:, 0])) :] = 90  # something stands before its right half
    found = find_board(seen, made)
    assert found is not None
    assert 10 <= len(found) < 25
    assert errors(found, made, uv).max() < 0.5


@pytest.mark.parametrize("text", ["chessboard:9x6", "charuco:8x6", "circles:7x6", "aprilgrid:3x2"])
def test_no_board_is_found_in_noise_or_in_a_blank_picture(text):
    made = board(text)
    noise = np.random.default_rng(0).integers(0, 256, (240, 320)).astype(np.uint8)
    assert find_board(noise, made) is None
    assert find_board(np.full((240, 320), 128, np.uint8), made) is None


def test_a_corner_that_went_astray_is_found_again():
    made, rig = board("chessboard:9x6"), pinhole_rig()
    T = poses(made, 1, seed=3)[0]
    uv, _ = Lens.of(rig.left).pixels(made.points_m @ T[:3, :3].T + T[:3, 3])
    moved = uv.copy()
    moved[20] += (6.0, -5.0)  # as OpenCV's own refinement did on two real pictures
    found, sure = on_grid(picture(rig.left, made, T), moved, 9, 6)
    assert sure.all()
    assert np.linalg.norm(found - uv, axis=1).max() < 0.1


def test_a_corner_that_cannot_be_found_is_left_out():
    made, rig = board("chessboard:9x6"), pinhole_rig()
    T = poses(made, 1, seed=3)[0]
    uv, _ = Lens.of(rig.left).pixels(made.points_m @ T[:3, :3].T + T[:3, 3])
    seen = picture(rig.left, made, T)
    x, y = uv[20].round().astype(int)
    seen[y - 12 : y + 13, x - 12 : x + 13] = 128
    _, sure = on_grid(seen, uv, 9, 6)
    assert not sure[20]
    assert sure.sum() >= 49


def test_the_board_that_kalibr_prints_is_read_whatever_way_its_tags_are_turned():
    made, cell = board("aprilgrid:3x2", 0.1), 12
    tag, gap = 10 * cell, 3 * cell  # a border of two bits around six by six
    pitch = tag + gap
    flat = np.full((2 * pitch + gap, 3 * pitch + gap), 255, np.uint8)
    for number, (row, column) in enumerate(((1, 0), (1, 1), (1, 2), (0, 0), (0, 1), (0, 2))):
        cells = cv2.aruco.generateImageMarker(dictionary_of(made), number, tag, borderBits=2)
        y, x = row * pitch + gap, column * pitch + gap
        flat[y : y + tag, x : x + tag] = np.rot90(cells, 3)
    for y, x in np.ndindex(3, 4):
        flat[y * pitch : y * pitch + gap, x * pitch : x * pitch + gap] = 0
    flat = np.pad(flat, gap, constant_values=255)
    height, width = flat.shape
    frame = np.float32([[0, 0], [width, 0], [width, height], [0, height]])
    seen_at = np.float32([[30, 20], [350, 40], [330, 270], [50, 250]])
    H = cv2.getPerspectiveTransform(frame, seen_at)
    seen = cv2.warpPerspective(cv2.GaussianBlur(flat, (0, 0), 1.0), H, (400, 300), borderValue=90)
    found = find_board(seen, made)
    assert found is not None
    assert len(found) == 24
    at = made.points_m[:, :2] * tag / made.square_m + 2 * gap - 0.5
    uv = cv2.perspectiveTransform(at[None], H)[0]
    assert np.linalg.norm(found.uv - uv[found.ids], axis=1).max() < 0.1
