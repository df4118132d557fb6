"""`convert` cleans by default: everywhere alike, counted, and not where nobody asked."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.pictures.depth_png import read_depth_png
from pseudolidar.formats.pictures.disparity_png import read_disparity_png
from pseudolidar.formats.points.pcd import read_pcd

STREET = ["synthetic:street:1", "--width-px", "621", "--to", "pcd,disparity,depth"]


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    """Output folder and text of the terminal by the flags of cleaning."""
    known = {}

    def of(*flags):
        if flags not in known:
            out = tmp_path_factory.mktemp("out")
            assert main(["convert", STREET[0], str(out), *STREET[1:], *flags]) == 0
            (frame,) = json.loads((out / "report.json").read_text())["per_frame"]
            known[flags] = out, frame
        return known[flags]

    return of


def test_what_is_removed_is_removed_from_all_outputs_and_counted(converted):
    (out, frame), (_, whole) = converted(), converted("--clean", "none")
    removed = {name: n for name, n in frame.items() if name.startswith("pixels_removed_")}
    assert len(removed) == 6
    assert removed["pixels_removed_sky"] > 100
    assert removed["pixels_removed_flying"] > 100
    disparity = read_disparity_png(out / "disparity" / "000000.png").valid
    depth = read_depth_png(out / "depth" / "000000.png").valid
    column, row = np.rint(read_pcd(out / "pcd" / "000000.pcd").uv).astype(int).T
    assert disparity.sum() == frame["pixels_kept_by_cleaning"]
    assert not (depth & ~disparity).any()
    assert disparity[row, column].all()
    assert frame["points"] < whole["points"]
    assert sum(removed.values()) + disparity.sum() == pytest.approx(
        whole["density"] * disparity.size
    )


def test_density_is_the_matchers(converted):
    frames = [converted(*flags)[1] for flags in ((), ("--clean", "none"))]
    assert frames[0]["density"] == frames[1]["density"]
    assert not any(name.startswith("pixels_removed_") for name in frames[1])


def test_each_part_has_its_own_flag(converted):
    _, frame = converted("--clean.no-sky", "--clean.no-flying")
    assert frame["pixels_removed_sky"] == 0
    assert frame["pixels_removed_flying"] == 0
    assert frame["pixels_removed_far_ghosts"] > 0


def test_the_terminal_and_the_page_say_what_was_removed(tmp_path, capsys):
    assert main(["convert", STREET[0], str(tmp_path), *STREET[1:]]) == 0
    text = capsys.readouterr().out
    assert "% sky" in text
    assert "% flying pixels" in text
    page = (tmp_path / "report.html").read_text()
    assert "Removed pixels by reason: sky cyan, near-lens noise magenta" in page


def test_organised_clouds_keep_their_shape(tmp_path):
    flags = ["--reproject.organised"]
    assert main(["convert", STREET[0], str(tmp_path), *STREET[1:], *flags]) == 0
    cloud = read_pcd(tmp_path / "pcd" / "000000.pcd")
    disparity = read_disparity_png(tmp_path / "disparity" / "000000.png")
    assert cloud.shape == disparity.values.shape
    assert not (cloud.valid & ~disparity.valid.ravel()).any()
    assert cloud.valid.any()
