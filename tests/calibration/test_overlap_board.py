"""Places of pairs from a board that two of them see at the same moment."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.boards.board import BoardName
from pseudolidar.calibration.overlap import Trust
from pseudolidar.calibration.overlap_board import BoardSight, SharedBoard, read_alike
from pseudolidar.calibration.overlap_fit import places_found
from pseudolidar.errors import OverlapInsufficient, UsageError
from pseudolidar.structures.body import BodyRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from tests.body_rigs import body_rig, off_by, perturbed, rig

SCALE = 3  # pictures of 960x600
SQUARE_M = 0.055
BOARD = SharedBoard(BoardName("chessboard", 9, 6), SQUARE_M)
# Where the board is held: straight between front and left, and between front and right.
BEARINGS_DEG = {"left": 27.5, "right": -30.0}
FRAMES = 3
PX = 24  # of a square of the drawn board
# From pixels of the drawing to metres of the board, whose first corner is two squares in.
STEP_M, START_M = SQUARE_M / PX, SQUARE_M * (0.5 / PX - 2)


def drawn() -> np.ndarray:
    """A chessboard of 9x6 inner corners with a white border of one square."""
    squares = np.indices((7, 10)).sum(axis=0) % 2
    whole = np.ones((9, 12), np.uint8)
    whole[1:-1, 1:-1] = squares
    return np.kron(whole, np.full((PX, PX), 200, np.uint8)) + 30


def held(bearing_deg: float, number: int) -> np.ndarray:
    """(4, 4) the board in the body: 3.4 m away, its face to the body, tilted."""
    rng = np.random.default_rng([number, int(abs(bearing_deg))])
    R_facing = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # x right, y down, z away
    yaw = cv2.Rodrigues(np.array([0, 0, np.radians(bearing_deg)]))[0]
    tilt = cv2.Rodrigues(np.radians(rng.uniform(-10, 10, 3)))[0]
    T = np.eye(4)
    T[:3, :3] = yaw @ R_facing @ tilt
    middle = yaw @ [rng.uniform(3.3, 3.6), 0, rng.uniform(-0.1, 0.1)]
    T[:3, 3] = middle - T[:3, :3] @ [4 * SQUARE_M, 2.5 * SQUARE_M, 0]
    return T


def seen(T_body_board: np.ndarray, name: str, number: int) -> StereoFrame:
    """The board as both eyes of a pair see it, with noise."""
    own = rig(SCALE)
    rng = np.random.default_rng([number, len(name)])
    to_board = np.array([[STEP_M, 0, START_M], [0, STEP_M, START_M], [0, 0, 1]])
    T_left = np.linalg.inv(body_rig()[name].T_base_link_left.matrix) @ T_body_board
    pictures = []
    for camera, T in ((own.left, T_left), (own.right, own.T_right_left.matrix @ T_left)):
        H = camera.K @ T[:3, [0, 1, 3]] @ to_board
        size = camera.size_px
        if T[2, 3] > 0.2:
            picture = cv2.warpPerspective(drawn(), H, size, flags=cv2.INTER_LINEAR, borderValue=90)
        else:
            picture = np.full((size[1], size[0]), 90, np.uint8)
        noisy = picture + rng.normal(0, 2, picture.shape)
        pictures.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return StereoFrame(*pictures, own, str(number), number, 1)


@functools.cache
def sights() -> tuple[dict[str, BoardSight], ...]:
    return tuple(frames())


def frames() -> Iterator[dict[str, BoardSight]]:
    """What front and one neighbour see, frame by frame."""
    for neighbour, bearing_deg in BEARINGS_DEG.items():
        for number in range(FRAMES):
            T = held(bearing_deg, number)
            found = {
                name: BoardSight.of(seen(T, name, number), BOARD.pattern)
                for name in ("front", neighbour)
            }
            yield {name: sight for name, sight in found.items() if sight is not None}


def places(body: BodyRig) -> dict[str, Pose]:
    return {pair.name: pair.T_base_link_left for pair in body.pairs}


def test_corners_are_where_the_board_is() -> None:
    T = held(27.5, 0)
    sight = BoardSight.of(seen(T, "left", 0), BOARD.pattern)
    assert sight is not None
    assert len(sight) == 54
    in_body = body_rig()["left"].T_base_link_left.apply(sight.xyz)
    want = BOARD.pattern.points_m @ T[:3, :3].T + T[:3, 3]
    ways = [np.linalg.norm(in_body - want[turn[sight.ids]], axis=1)
            for turn in BOARD.pattern.turns()]  # fmt: skip
    off = min(ways, key=np.median)
    assert np.median(off) < 0.01
    # No larger than they are said to be; drawn boards are sharper than photographed ones.
    assert np.median(off / sight.sigma_m) < 1
    assert BoardSight.of(seen(held(180, 0), "front", 0), BOARD.pattern) is None


def test_a_board_read_from_the_other_end_is_turned() -> None:
    T = held(27.5, 1)
    both = {name: BoardSight.of(seen(T, name, 1), BOARD.pattern) for name in ("front", "left")}
    given = places(perturbed(body_rig(), turn_deg=2, shift_m=0.1))
    turned = both["left"]
    assert turned is not None
    turned = BoardSight(53 - turned.ids, turned.xyz, turned.sigma_m, turned.across_m)
    alike = read_alike({**both, "left": turned}, given, BOARD.pattern)
    front, left = alike["front"], alike["left"]
    _, at, other = np.intersect1d(front.ids, left.ids, return_indices=True)
    true = places(body_rig())
    apart = true["front"].apply(front.xyz[at]) - true["left"].apply(left.xyz[other])
    assert np.median(np.linalg.norm(apart, axis=1)) < 0.02


@pytest.mark.parametrize(("turn_deg", "shift_m", "seed"), [(0, 0, 0), (3, 0.15, 1), (5, 0.3, 2)])
def test_perturbed_places_are_recovered_to_millimetres(
    turn_deg: float, shift_m: float, seed: int
) -> None:
    given = places(perturbed(body_rig(), turn_deg=turn_deg, shift_m=shift_m, seed=seed))
    read = [read_alike(frame, given, BOARD.pattern) for frame in sights()]
    assert sum(len(frame) == 2 for frame in read) >= 2 * FRAMES - 2
    found = places_found(read, given, "front", BOARD, Trust(given_shift_m=1, given_turn_deg=10))
    for name, place in found.items():
        pair = body_rig()[name].placed(place.T_base_link_left)
        off_m, off_deg = off_by(BodyRig((pair,)), name)
        assert off_m < 0.01, name
        assert off_deg < 0.25, name
        assert off_m < 4 * np.linalg.norm(place.translation_sigma_m)
        assert place.translation_sigma_m.max() < 0.05
        assert place.matches >= 54 * (FRAMES - 1)


def test_a_board_that_no_neighbour_shares_is_refused() -> None:
    given = places(body_rig())
    front_left = [frame for frame in sights() if "left" in frame]
    with pytest.raises(OverlapInsufficient, match="right shares too little"):
        places_found(front_left, given, "front", BOARD, Trust())
    with pytest.raises(UsageError, match="squares of 0 m"):
        _ = SharedBoard().pattern
