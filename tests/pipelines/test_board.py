"""Boards on paper: what comes out of a PDF renderer has the size that the sheet says."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.calibration.boards.board import Board, BoardName
from pseudolidar.calibration.boards.find import find_board
from pseudolidar.cli import main

KINDS = ["chessboard", "charuco", "circles", "acircles", "aprilgrid"]
DPI = 150


def rendered(pdf: Path) -> np.ndarray:
    """The page as poppler draws it."""
    if shutil.which("pdftoppm") is None:
        pytest.skip("pdftoppm is not installed")
    subprocess.run(
        ["pdftoppm", "-r", str(DPI), "-gray", "-png", "-singlefile", str(pdf), str(pdf)],
        check=True,
    )
    return cv2.imread(f"{pdf}.png", cv2.IMREAD_GRAYSCALE)


def drawn(tmp_path: Path, capsys, *args: str) -> tuple[Path, dict]:
    assert main(["board", *args, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    return Path(told["out"]), told


def scale(page: np.ndarray, told: dict, dpi: float) -> tuple[float, float]:
    """Size of the board in the page over what was said, across and down."""
    board = Board.of(
        BoardName.parse(told["board"]),
        told["square_m"],
        marker_m=told["marker_m"],
        dictionary=told["dictionary"],
    )
    found = find_board(page, board)
    assert found is not None
    assert len(found) == len(board.points_m)
    points = board.points_m[found.ids][:, :2]
    A = np.column_stack([points, np.ones(len(points))])
    fit = np.linalg.lstsq(A, found.uv, rcond=None)[0]
    off = np.linalg.norm(A @ fit - found.uv, axis=1)
    assert off.max() < 0.6
    across, down = np.linalg.norm(fit[:2], axis=1) / (dpi / 0.0254)
    assert abs(fit[0] @ fit[1]) < 1e-2 * np.linalg.norm(fit[0]) ** 2
    return across, down


@pytest.mark.parametrize("kind", KINDS)
def test_a_printed_board_has_its_size_and_is_found(tmp_path, capsys, kind):
    pdf, told = drawn(tmp_path, capsys, "--type", kind, "--out", str(tmp_path / "board.pdf"))
    across, down = scale(rendered(pdf), told, DPI)
    assert across == pytest.approx(1, abs=1e-3)
    assert down == pytest.approx(1, abs=1e-3)


def test_the_rulers_of_a_pdf_are_as_long_as_they_say(tmp_path, capsys):
    args = "--type", "chessboard:9x6", "--square", "0.025", "--out", str(tmp_path / "board.pdf")
    page = rendered(drawn(tmp_path, capsys, *args)[0])
    assert page.shape == pytest.approx((210 / 25.4 * DPI, 297 / 25.4 * DPI), abs=1)
    runs = [longest_run(row) for row in page]
    # 250 mm of board in the longest rows of squares would be broken: only the ruler is one line.
    assert max(runs) / DPI * 25.4 == pytest.approx(250, abs=0.5)
    assert max(longest_run(column) for column in page.T) / DPI * 25.4 == pytest.approx(170, abs=0.5)


def longest_run(line: np.ndarray) -> int:
    dark = np.concatenate([[0], (line < 160).astype(int), [0]])
    edges = np.flatnonzero(np.diff(dark))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def test_a_png_says_its_resolution_and_shows_the_same(tmp_path, capsys):
    args = "--type", "charuco", "--dpi", "200", "--out", str(tmp_path / "board.png")
    file, told = drawn(tmp_path, capsys, *args)
    data = file.read_bytes()
    place = data.index(b"pHYs")
    per_m, _, unit = struct.unpack(">IIB", data[place + 4 : place + 13])
    assert (per_m, unit) == (7874, 1)
    page = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    assert scale(page, told, per_m * 0.0254) == pytest.approx((1, 1), abs=1e-3)


def test_an_svg_is_in_millimetres(tmp_path, capsys):
    args = "--type", "circles:9x7", "--square", "0.02", "--out", str(tmp_path / "board.svg")
    root = ET.parse(drawn(tmp_path, capsys, *args)[0]).getroot()
    assert (root.get("width"), root.get("height")) == ("297mm", "210mm")
    assert root.get("viewBox") == "0 0 297 210"
    circles = root.findall("{http://www.w3.org/2000/svg}circle")
    assert len(circles) == 63
    x = sorted({round(float(circle.get("cx")), 3) for circle in circles})
    assert np.diff(x) == pytest.approx(20)


def test_the_same_board_gives_the_same_bytes(tmp_path, capsys):
    first, _ = drawn(tmp_path, capsys, "--type", "aprilgrid", "--out", str(tmp_path / "a.pdf"))
    second, _ = drawn(tmp_path, capsys, "--type", "aprilgrid", "--out", str(tmp_path / "b.pdf"))
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--type", "chessboard:9x6", "--square", "0.05"], "--paper a2"),
        (["--type", "chess"], "chessboard:9x6"),
        (["--type", "charuco", "--marker", "0.5"], "--marker"),
        (["--type", "charuco", "--out", "board.docx"], ".pdf, .svg, .png"),
        (["--type", "charuco", "--dpi", "0"], "72 to 2400"),
        (["--type", "chessboard:60x60", "--square", "0.1"], "a smaller board"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, capsys, monkeypatch, args, words):
    monkeypatch.chdir(tmp_path)
    assert main(["board", *args]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_file_is_replaced_only_when_asked(tmp_path, capsys):
    args = ["board", "--type", "charuco", "--out", str(tmp_path / "board.pdf")]
    assert main(args) == 0
    assert main(args) == 2
    assert main([*args, "--overwrite"]) == 0
    # ... and never what is no such file.
    (tmp_path / "board.pdf").write_bytes(b"\x89PNG, mine")
    assert main([*args, "--overwrite"]) == 2
    assert "no PDF file" in capsys.readouterr().err
    assert (tmp_path / "board.pdf").read_bytes() == b"\x89PNG, mine"
