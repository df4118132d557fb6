import numpy as np
import pytest

from pseudolidar.calibration.boards.board import Board, BoardName
from pseudolidar.calibration.boards.markers import april_ids
from pseudolidar.errors import UsageError
from tests.boards import board


@pytest.mark.parametrize(
    "text", ["chessboard:9x6", "charuco:8x6", "circles:7x6", "acircles:4x11", "aprilgrid:6x6"]
)
def test_a_board_reads_back_as_it_is_written(text):
    assert str(BoardName.parse(text)) == text


@pytest.mark.parametrize(
    "text",
    ["chessboard", "chessboard:9", "chess:9x6", "chessboard:9x-6", "chessboard:٩x6", "charuco:2x9",
     "chessboard:9x6 ", "chessboard:99x6", "chessboard:2x6", ""],
)  # fmt: skip
def test_what_is_no_board_is_refused(text):
    with pytest.raises(UsageError):
        BoardName.parse(text)


def test_squares_in_millimetres_and_markers_larger_than_squares_are_refused():
    with pytest.raises(UsageError, match=r"squares of 24\.23 m.*metres"):
        board("chessboard:9x6", 24.23)
    with pytest.raises(UsageError, match=r"markers of 0\.04 m"):
        board("charuco:8x6", 0.03, marker_m=0.04)
    with pytest.raises(UsageError, match="squares of nan"):
        board("chessboard:9x6", float("nan"))


def test_corners_lie_row_by_row_from_the_origin():
    points = board("chessboard:9x6", 0.5).points_m
    assert points.shape == (54, 3)
    assert points[10].tolist() == [0.5, 0.5, 0.0]
    staggered = board("acircles:4x11", 0.5).points_m
    assert staggered[4].tolist() == [0.5, 0.5, 0.0]  # the second row begins half a step later
    assert staggered[1].tolist() == [1.0, 0.0, 0.0]


def test_tags_are_numbered_upwards_from_the_bottom_left():
    grid = board("aprilgrid:3x2", 0.1)
    first = grid.points_m[april_ids(grid)[0]]
    assert first[0].round(6).tolist() == [0.0, 0.13, 0.0]  # its top left: one tag and a gap down
    assert first[2].round(6).tolist() == [0.1, 0.23, 0.0]


@pytest.mark.parametrize(
    ("text", "ways"),
    [("chessboard:9x6", 2), ("chessboard:7x7", 4), ("circles:7x6", 2), ("acircles:4x11", 1),
     ("acircles:4x10", 2), ("charuco:8x6", 1), ("aprilgrid:6x6", 1)],
)  # fmt: skip
def test_the_ways_to_read_a_board_are_turns_of_it(text, ways):
    made: Board = board(text)
    turns = made.turns()
    assert len(turns) == ways
    assert turns[0].tolist() == list(range(len(made.points_m)))
    for names in turns:
        assert sorted(names.tolist()) == turns[0].tolist()
        before, after = made.points_m[:, :2], made.points_m[names][:, :2]
        before, after = before - before.mean(axis=0), after - after.mean(axis=0)
        U, _, Vt = np.linalg.svd(after.T @ before)
        R = U @ Vt
        np.testing.assert_allclose(before @ R.T, after, atol=1e-9)
        assert np.linalg.det(R) > 0  # a board is not seen in a mirror
