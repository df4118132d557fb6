import cv2
import numpy as np
import pytest

from pseudolidar.calibration.boards.capture import (
    LEAST_SHARP_PX,
    ViewPlace,
    edge_width_px,
    is_new,
    is_sharp,
    moved_per_1000,
    movement_px,
)
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.coverage import CELLS, Coverage
from pseudolidar.calibration.boards.film import ENOUGH_VIEWS, chosen_views, follow_one_another
from pseudolidar.calibration.boards.seen import BoardSeen
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.twists import exp_twist
from tests.boards import Seeing, board, picture, pinhole_rig, poses, seen_by

BOARD, RIG = board("chessboard:9x6"), pinhole_rig()
SIZES = ((640, 480), (640, 480))
POSES = poses(BOARD, 12, near=1.8, spread=0.4)


def held(n: int) -> tuple[Corners, Corners]:
    return seen_by(RIG, BOARD, POSES[n], Seeing(0.0))


def moved(corners: Corners, by_px: float) -> Corners:
    return Corners(corners.ids, corners.uv + np.array([by_px, 0.0]))


def frame(name: str, pose: int, by_px: float = 0.0, *, sharp: bool = True) -> BoardSeen:
    left, right = held(pose)
    return BoardSeen(name, moved(left, by_px), moved(right, by_px), SIZES, (True, sharp))


def test_movement_is_that_of_the_corners_in_both_pictures():
    left, _ = held(0)
    assert movement_px(left, moved(left, 0.3)) == pytest.approx(0.3)
    half = Corners(left.ids[20:], left.uv[20:])
    assert movement_px(half, moved(left, 0.3)) == pytest.approx(0.3)
    assert moved_per_1000(left, moved(left, 2.0), 4000) == pytest.approx(0.5)
    nothing = Corners(np.zeros(0, np.int64), np.zeros((0, 2)))
    assert movement_px(left, nothing) == np.inf


@pytest.mark.parametrize("roll_deg", [0.0, 45.0])
def test_edges_are_as_wide_as_those_along_which_the_board_moved(roll_deg):
    T = exp_twist(np.array([0, 0, 0, 0, 0, np.deg2rad(roll_deg)]))
    T[:3, 3] = np.array([0, 0, 0.55]) - T[:3, :3] @ BOARD.points_m.mean(axis=0)
    uv, _ = Lens.of(RIG.left).pixels(BOARD.points_m @ T[:3, :3].T + T[:3, 3])
    corners = Corners(np.arange(54), uv)
    seen = picture(RIG.left, BOARD, T, noise=1.0, samples=1)
    across = cv2.getRotationMatrix2D((4, 4), -roll_deg, 1.0)
    smear = np.zeros((9, 9))
    smear[4] = 1
    smear = cv2.warpAffine(smear, across, (9, 9))
    along_rows = cv2.filter2D(seen, -1, smear / smear.sum())
    assert 1.5 < edge_width_px(seen, corners, BOARD.points_m) < 3
    assert is_sharp(seen, corners, BOARD.points_m)
    assert edge_width_px(along_rows, corners, BOARD.points_m) > 1.5 * LEAST_SHARP_PX
    assert not is_sharp(along_rows, corners, BOARD.points_m)
    assert not is_sharp(cv2.GaussianBlur(seen, (0, 0), 2.5), corners, BOARD.points_m)
    assert not is_sharp(np.full_like(seen, 90), corners, BOARD.points_m)


def test_a_view_is_new_where_it_stands_otherwise():
    places = [ViewPlace.of(held(n)[0], BOARD.points_m, SIZES[0]) for n in range(3)]
    assert not is_new(places[0], places)
    assert is_new(places[0], places[1:])
    left, _ = held(0)
    assert not is_new(ViewPlace.of(moved(left, 10.0), BOARD.points_m, SIZES[0]), places[:1])
    # A part of the same board is the same view, but for where its middle is.
    half = Corners(left.ids[:27], left.uv[:27])
    part = ViewPlace.of(half, BOARD.points_m, SIZES[0])
    assert part.size == pytest.approx(places[0].size, abs=0.02)
    assert part.lean_x == pytest.approx(places[0].lean_x, abs=0.02)


def test_coverage_says_where_nothing_was_seen():
    assert Coverage.of([], (640, 480)).share == 0
    left = Corners(np.arange(3), np.array([[0.0, 0.0], [639.0, 479.0], [320.0, 240.0]]))
    cover = Coverage.of([left], (640, 480))
    assert cover.counts.sum() == 3
    assert cover.share == pytest.approx(3 / (CELLS[0] * CELLS[1]))
    u, v = np.meshgrid(np.arange(0, 640, 20.0), np.arange(0, 480, 20.0))
    every = np.stack([u.ravel(), v.ravel()], axis=1)
    lacking = every[~((every[:, 0] > 430) & (every[:, 1] < 160))]
    cover = Coverage.of([Corners(np.arange(len(lacking)), lacking)], (640, 480))
    assert cover.emptiest == "top right"
    assert Coverage.of([Corners(np.arange(len(every)), every)], (640, 480)).emptiest == ""


def test_of_a_film_steady_sharp_and_new_views_are_taken():
    still = [frame(f"{pose}{part}", pose) for pose in range(2, ENOUGH_VIEWS) for part in "ab"]
    film = [
        frame("before", 0),  # nothing before it: may move
        frame("settling", 0, 0.5),
        frame("stillest", 0, 0.6),
        frame("shaking", 0, 1.0),
        frame("elsewhere", 1),
        frame("blurred", 1, sharp=False),
        BoardSeen("one eye", None, held(1)[1], SIZES),
        frame("again", 1),  # nobody knows what was before
        frame("second", 1),
        frame("back", 0),
        frame("known", 0),
        *still,
    ]
    chosen = chosen_views(film, BOARD)
    taken = [view.id for view in chosen.views]
    assert taken == ["stillest", "second", *(f"{pose}b" for pose in range(2, ENOUGH_VIEWS))]
    assert (chosen.unseen, chosen.moving, chosen.blurred, chosen.alike) == (1, 12, 1, 3)
    assert str(chosen).startswith("a film: 10 views taken of 27 frames")
    few = chosen_views(film, BOARD, most=2)
    assert [view.id for view in few.views] == ["stillest", "5b"]
    assert few.alike == chosen.alike + 8


def test_of_a_film_without_rest_moving_views_are_taken_too():
    film = [frame(f"{pose}{part}", pose, 2.0 * part) for pose in range(12) for part in range(3)]
    chosen = chosen_views(film, BOARD)
    assert [view.id for view in chosen.views] == [f"{pose}1" for pose in range(12)]
    assert "moving ones are among them" in str(chosen)
    rushing = [frame(f"{pose}{part}", pose, 20.0 * part) for pose in range(12) for part in range(3)]
    assert not chosen_views(rushing, BOARD).views


def test_single_pictures_are_no_film():
    assert not follow_one_another([frame(str(pose), pose) for pose in range(12)])
    assert follow_one_another([frame(f"{n}", n // 2) for n in range(24)])
    assert not follow_one_another([BoardSeen(str(n), None, None, SIZES) for n in range(3)])
