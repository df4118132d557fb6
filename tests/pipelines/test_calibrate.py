"""From pictures of a board to a rig file, on the command line."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.rigs.rig_json import read_rig
from pseudolidar.running.board_search import MOST_FRAMES, boards_in
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.sources.bare_films import Films
from pseudolidar.sources.bare_pairs import BarePairs, Pictures
from pseudolidar.sources.source import SourceSummary
from tests.boards import board, picture, pinhole_rig, poses
from tests.videos import LOSSLESS, write_video

PAIRS = 8
RIG = pinhole_rig()
BOARD = board("chessboard:9x6")
HELD = 3  # frames that the board is held still for


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pairs of a chessboard; not to be changed."""
    folder = tmp_path_factory.mktemp("boards")
    for n, T in enumerate(poses(BOARD, PAIRS, seed=2, near=1.7, spread=0.4)):
        for eye, camera, T_eye in (
            ("left", RIG.left, np.eye(4)),
            ("right", RIG.right, RIG.T_right_left.matrix),
        ):
            seen = picture(camera, BOARD, T_eye @ T, seed=n, samples=1)
            cv2.imwrite(str(folder / f"{eye}{n:02d}.png"), seen)
    return folder


def changed(pictures: Path, folder: Path) -> Path:
    for file in pictures.iterdir():
        (folder / file.name).symlink_to(file)
    return folder


def command(folder: Path, out: Path, *more: str) -> list[str]:
    fixed = ["--board", "chessboard:9x6", "--square", "0.03", "--model", "pinhole"]
    return ["calibrate", str(folder), *fixed, "--out", str(out), *more]


def test_a_rig_file_that_other_verbs_read(pictures, tmp_path, capsys):
    out = tmp_path / "rig.json"
    assert main(command(pictures, out, "--json")) == 0
    told = json.loads(capsys.readouterr().out)
    wanted = {"model", "rms_left", "rms_right", "rms_stereo", "baseline_m", "baseline_sigma_m",
              "holdout_row_error_px", "views_used", "views_dropped", "swapped"}  # fmt: skip
    assert wanted <= set(told)
    assert told["model"] == "pinhole"
    assert (told["views_used"], told["views_dropped"], told["swapped"]) == (PAIRS, 0, False)
    assert told["rms_stereo"] < 0.1
    assert told["holdout_row_error_px"] < 0.1
    truth_m = float(np.linalg.norm(RIG.T_right_left.translation_m))
    assert told["baseline_m"] == pytest.approx(truth_m, abs=4 * told["baseline_sigma_m"] + 1e-4)
    rig = read_rig(out)
    assert rig.left.focal_px == pytest.approx(RIG.left.focal_px, rel=0.01)
    assert rig.quality is not None
    assert rig.quality.views == PAIRS


def test_the_same_for_people(pictures, tmp_path, capsys):
    assert main(command(pictures, tmp_path / "rig.json")) == 0
    out = capsys.readouterr().out
    assert "8 used of 8" in out
    assert "verdict: " in out
    assert "next: Take more pairs" in out  # eight are not many


def test_a_page_shows_it(pictures, tmp_path, capsys):
    page = tmp_path / "report.html"
    more = "--report", str(page), "--frames", "0:6"
    assert main(command(pictures, tmp_path / "rig.json", *more)) == 0
    assert str(page) in capsys.readouterr().out
    text = page.read_text()
    heads = re.findall("<h2>(.*?)</h2>", text)
    for head in ("What it is worth", "Rectified pairs", "Views", "Residuals", "Coverage"):
        assert head in heads
    assert "This calibration is poor: pairs used 6" in text
    assert text.count("<img") == 9
    shown = re.search(r'alt="view 00[^"]*" src="data:image/jpeg;base64,([^"]+)"', text)
    both = cv2.imdecode(np.frombuffer(base64.b64decode(shown[1]), np.uint8), 0)
    assert both.shape == (480, 1280)
    assert main(command(pictures, tmp_path / "other.json", *more)) == 2  # not written over
    picture = tmp_path / "left.jpg"
    picture.write_bytes(b"\xff\xd8\xff\xe0mine")
    over = "--report", str(picture), "--overwrite"
    assert main(command(pictures, tmp_path / "other.json", *over)) == 2
    assert picture.read_bytes() == b"\xff\xd8\xff\xe0mine"


def test_exchanged_eyes_are_named(pictures, tmp_path, capsys):
    folder = tmp_path / "swapped"
    folder.mkdir()
    for file in pictures.iterdir():
        eye = "right" if file.name.startswith("left") else "left"
        (folder / (eye + file.name.removeprefix("left").removeprefix("right"))).symlink_to(file)
    assert main(command(folder, tmp_path / "rig.json")) == 0
    assert "SWAPPED" in capsys.readouterr().out
    assert read_rig(tmp_path / "rig.json").T_right_left.translation_m[0] < 0


def test_a_rig_is_replaced_only_when_asked_and_kept(pictures, tmp_path, capsys):
    out = tmp_path / "rig.json"
    assert main(command(pictures, out)) == 0
    first = out.read_bytes()
    assert main(command(pictures, out)) == 2
    assert "there is such a file already" in capsys.readouterr().err
    assert main(command(pictures, out, "--overwrite", "--frames", "0:7")) == 0
    assert (tmp_path / "rig.previous.json").read_bytes() == first
    assert read_rig(out).quality.views == 7


def test_pictures_that_cannot_be_used_are_told_with_the_reason(pictures, tmp_path, capsys):
    folder = changed(pictures, tmp_path)
    (folder / "left03.png").unlink()
    (folder / "left03.png").write_bytes((pictures / "left03.png").read_bytes()[:5000])
    (folder / "right05.png").unlink()
    cv2.imwrite(str(folder / "right05.png"), np.full((480, 640), 90, np.uint8))
    (folder / "right06.png").unlink()
    cv2.imwrite(str(folder / "right06.png"), np.full((240, 320), 90, np.uint8))
    assert main(command(folder, tmp_path / "rig.json", "--json")) == 4
    told = json.loads(capsys.readouterr().out)
    reasons = {view["id"]: view["reason"] for view in told["dropped"]}
    assert set(reasons) == {"03", "05", "06"}
    assert "ImageTruncated" in reasons["03"] or "ImageUnreadable" in reasons["03"]
    assert reasons["05"] == "the right eye does not see the board"
    assert "640x480 and 320x240" in reasons["06"]
    assert (told["views_used"], told["views_dropped"]) == (5, 3)


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        (["--board", "chessboard:8x5", "--frames", "0:1"], 3, "BoardNotFound"),
        (["--board", "chessboard"], 2, "--board"),
        (["--square", "30"], 2, "metres"),
        (["--square", "-1"], 2, "metres"),
        (["--frames", "0:4"], 3, "4 of 4 pairs"),
        (["--frames", "77"], 2, "77"),
        (["--model", "cubic"], 2, "model"),
    ],
)
def test_what_cannot_be_meant_is_refused(pictures, tmp_path, capsys, more, code, words):
    args = command(pictures, tmp_path / "rig.json")
    for flag, value in zip(more[::2], more[1::2], strict=True):
        if flag in args:
            args[args.index(flag) + 1] = value
        else:
            args += [flag, value]
    assert main(args) == code
    assert words in capsys.readouterr().err
    assert not (tmp_path / "rig.json").exists()


def test_a_folder_without_pairs_is_refused(tmp_path, capsys):
    assert main(command(tmp_path, tmp_path / "rig.json")) == 3
    assert "no pair of pictures" in capsys.readouterr().err


@pytest.fixture(scope="module")
def film(pictures: Path) -> dict[str, list[np.ndarray]]:
    """Each pair for three frames, with a blurred one between."""
    frames: dict[str, list[np.ndarray]] = {"left": [], "right": []}
    for eye, film in frames.items():
        for n in range(PAIRS):
            seen = cv2.imread(str(pictures / f"{eye}{n:02d}.png"))
            film += [seen] * HELD + [cv2.blur(seen, (25, 1))]
    return frames


def test_a_film_with_both_eyes_side_by_side(film, tmp_path, capsys):
    wide = [np.concatenate(pair, axis=1) for pair in zip(*film.values(), strict=True)]
    write_video(tmp_path / "both.mkv", wide, **LOSSLESS)
    args = command(tmp_path / "both.mkv", tmp_path / "rig.json", "--json")
    assert main(args) == 0
    told = json.loads(capsys.readouterr().out)
    assert "side-by-side video both.mkv" in told["source"]
    assert told["notes"][0].startswith(f"a film: {PAIRS} views taken of {len(wide)} frames")
    assert (told["views_used"], told["views_dropped"]) == (PAIRS, 0)
    # The second frame of each pose: the first one moved since the frame before.
    assert [int(view["id"]) % (HELD + 1) for view in told["views"]] == [1] * PAIRS
    assert read_rig(tmp_path / "rig.json").left.size_px == (640, 480)


def test_two_films_whose_frames_are_paired_by_time(film, tmp_path):
    poses_of_it = 3
    for eye, frames in film.items():
        write_video(tmp_path / f"{eye}.mkv", frames[: poses_of_it * (HELD + 1)], **LOSSLESS)
    pairs = Films(str(tmp_path)).open()
    assert "two videos, left.mkv and right.mkv: 12 pairs" in pairs.summary.line
    looked = boards_in(pairs, BOARD, CrewPlan())
    assert [pairs.ids.index(seen.id) for seen in looked.found] == [1, 5, 9]


def test_a_film_in_which_nothing_is_held_still_is_refused(film, tmp_path, capsys):
    wide = [np.concatenate([film["left"][n], film["right"][n]], axis=1) for n in (0, 0, 4, 4)]
    write_video(tmp_path / "both.mkv", [*wide, wide[0]], **LOSSLESS)
    assert main(command(tmp_path / "both.mkv", tmp_path / "rig.json")) == 3
    said = capsys.readouterr().err
    assert "2 of 2 pairs (left 2, right 2); a film: 2 views taken of 5 frames" in said
    assert not (tmp_path / "rig.json").exists()


def test_a_video_of_single_pictures_is_no_film(pictures):
    shown = Pictures(str(pictures)).open()
    video = BarePairs(shown.summary, shown.ids, (), shown.read, film=True)
    looked = boards_in(video, BOARD, CrewPlan())
    assert [seen.id for seen in looked.found] == list(shown.ids)
    assert not looked.notes


def test_of_a_long_film_neighbours_are_looked_at():
    read: list[int] = []

    def blank(number: int) -> tuple[np.ndarray, np.ndarray]:
        read.append(number)
        return np.zeros((24, 32), np.uint8), np.zeros((24, 32), np.uint8)

    summary = SourceSummary(kind="films", path="film", line="a film", notes=())
    pairs = BarePairs(summary, tuple(f"{n:06d}" for n in range(9001)), (), blank, film=True)
    looked = boards_in(pairs, BOARD, CrewPlan(1))
    seen = np.unique(read)
    assert len(seen) == MOST_FRAMES
    assert set(np.diff(seen[::2])) == {22, 23}
    assert set(seen[1::2] - seen[::2]) == {1}
    assert looked.notes == ("800 of 9001 pairs looked at",)


def test_pictures_that_are_all_cut_are_named_and_not_called_without_a_board(
    pictures: Path, tmp_path: Path, capsys
) -> None:
    for path in pictures.glob("*.png"):
        (tmp_path / path.name).write_bytes(path.read_bytes()[:3000])
    args = ["calibrate", str(tmp_path), "--board", "chessboard:9x6", "--square", "0.03"]
    assert main([*args, "--out", str(tmp_path / "rig.json"), "--json"]) == 3
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "ImageTruncated"
    assert "00.png" in error["path"]
