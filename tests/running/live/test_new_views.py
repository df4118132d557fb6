"""Automatic capture: a film of a board, traced ray by ray, through the code that reads cameras."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from pseudolidar.pipelines.live import Live, run

from pseudolidar.calibration.boards.board import BoardName
from pseudolidar.calibration.boards.seen import FindInPair
from pseudolidar.errors import UsageError
from pseudolidar.running.live.new_views import NewViews
from pseudolidar.running.live.saving import saved_pairs
from pseudolidar.sources.bare_films import recognise_bare
from pseudolidar.sources.capture.cameras import Cameras, CameraSettings
from pseudolidar.sources.capture.eyes import Eyes
from tests.boards import board, picture, pinhole_rig, poses
from tests.cameras import write_eyes
from tests.sources.capture.test_cameras import drained
from tests.sources.capture.test_eyes import shots

BOARD, RIG = board("chessboard:9x6"), pinhole_rig()
POSES, STEADY = 4, 3
SETTINGS = CameraSettings(speed=20.0, kept=100)


def both(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    right = RIG.T_right_left.matrix @ pose
    return tuple(
        picture(camera, BOARD, T, samples=1) for camera, T in ((RIG.left, pose), (RIG.right, right))
    )


def blurred(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), 6)


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int]]:
    """Each pose is shown still for three pictures, then out of focus; then all of them again.

    With the numbers of the pictures that are to be kept: the second of each pose.
    """
    views = [both(pose) for pose in poses(BOARD, POSES, seed=2)]
    empty = np.full_like(views[0][0], 90)
    shown: list[tuple[np.ndarray, np.ndarray]] = [(empty, empty)]
    wanted = []
    for left, right in views:
        wanted.append(len(shown) + 1)
        shown += [(left, right)] * STEADY + [(blurred(left), blurred(right))] * 2
    shown += [(views[0][0], empty)] * 2  # one eye alone sees it
    shown += [pair for pair in views for _ in range(2)]
    folder = tmp_path_factory.mktemp("film")
    lefts, rights = zip(*shown, strict=True)
    write_eyes(folder, lefts, rights, codec="ffv1", pix_fmt="gray", form="gray")
    return folder, wanted


def job(folder: Path, pairs: Path) -> Live:
    return Live(
        str(folder / "left.mkv"),
        str(folder / "right.mkv"),
        capture=pairs,
        board=BoardName.parse("chessboard:9x6"),
        realtime=True,
        camera=SETTINGS,
    )


def test_each_pose_is_kept_once_when_it_is_still_and_sharp(film, tmp_path: Path) -> None:
    folder, wanted = film
    report = run(job(folder, tmp_path))
    found = report.as_dict()["live"]["board"]
    assert found["views"] == POSES == len(report.result.committed)
    assert 0 < found["coverage_left"] < 1
    assert found["next_left"]
    assert "hold it where it was not yet: left:" in report.text()
    pairs = recognise_bare(str(tmp_path)).open()
    assert len(pairs.ids) == POSES
    capture = cv2.VideoCapture(str(folder / "left.mkv"))
    pictures = [capture.read()[1][..., 0] for _ in range(wanted[-1] + 1)]
    for index, number in enumerate(wanted):
        pair = pairs.load(index)
        np.testing.assert_array_equal(pair.left, pictures[number])
        seen = FindInPair(BOARD)(pair.left, pair.right, pair.id)
        assert len(seen.left) == len(seen.right) == 54


def test_a_board_that_was_just_brought_in_may_still_move() -> None:
    pose = poses(BOARD, 1, seed=2)[0]
    still = shots(*both(pose))
    shifted = pose.copy()
    shifted[0, 3] += 0.01
    views = NewViews(BOARD, Eyes())
    assert not views(still)
    assert views.words.startswith("moving;")
    assert not views(shots(*both(shifted)))
    assert views.words.startswith("moving;")
    assert not views(still)
    assert views(still)
    assert not views(still)
    assert views.words.startswith("as one of the others; 1 views")


@pytest.mark.parametrize(("exchanged", "order"), [(False, "right"), (True, "exchanged")])
def test_exchanged_cameras_are_told_once_two_views_agree(
    caplog, exchanged: bool, order: str
) -> None:
    views = NewViews(BOARD, Eyes(swap=exchanged))
    pairs = [shots(*both(pose)) for pose in poses(BOARD, 2, seed=2)]
    said = []
    for pair in pairs:
        assert [views(pair) for _ in range(2)] == [False, True]
        said.append(views.as_dict()["eyes"])
    assert said == ["unknown", order]
    assert ("name the other camera first" in views.words) is exchanged
    told = [record for record in caplog.records if record.levelname == "WARNING"]
    assert len(told) == exchanged


def test_what_was_kept_before_is_not_new(film, tmp_path: Path) -> None:
    folder, _ = film
    committed = run(job(folder, tmp_path)).result.committed
    views = NewViews(BOARD, Eyes())
    views.remember(saved_pairs(tmp_path, [record.id for record in committed]))
    assert f"{POSES} views" in views.words
    cameras = Cameras(str(folder / "left.mkv"), str(folder / "right.mkv"), True, SETTINGS)
    with cameras.open().begin() as capture:
        shown, _ = drained(capture)
    verdicts = [views(shots) for shots in shown]
    assert len(verdicts) > POSES * STEADY
    assert not any(verdicts)


def test_a_board_is_only_looked_for_to_save_pairs(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--board without --capture"):
        Live("0", "2", board=BoardName.parse("chessboard:9x6"))
    with pytest.raises(UsageError, match="--every and --board"):
        Live("0", "2", capture=tmp_path, every=1.0, board=BoardName.parse("chessboard:9x6"))
