"""Files of maps of any size."""

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.formats.points.ply import read_ply
from pseudolidar.running.mapped import map_files
from pseudolidar.running.mapped.map_files import Shown, write_map
from pseudolidar.structures.cloud import PointCloud


def tiles(count: int, points: int) -> list[tuple[tuple[int, int], PointCloud]]:
    """Points in a line, 1 m apart."""
    clouds = []
    for number in range(count):
        xyz = np.zeros((points, 3), np.float32)
        xyz[:, 0] = number * points + np.arange(points)
        sigma = np.full(points, 0.1, np.float32)
        clouds.append(((number, 0), PointCloud(xyz, "map", sigma_m=sigma)))
    return clouds


def test_the_whole_is_all_tiles_and_what_is_shown_is_even(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(map_files, "MOST_SHOWN", 100)
    made = write_map(tmp_path, tiles(9, 37), ("ply",))
    files, figures = made.files, made.figures
    assert files == (tmp_path / "map.ply", tmp_path / "tiles")
    assert np.array_equal(read_ply(files[0]).xyz[:, 0], np.arange(9 * 37))
    assert (figures["points"], figures["tiles"]) == (333, 9)
    assert figures["extent_m"] == [332.0, 0.0, 0.0]
    assert figures["sigma_m_median"] == pytest.approx(0.1)
    assert made.shown is not None
    assert np.array_equal(made.shown.xyz[:, 0], np.arange(0, 333, 4))


def test_a_small_map_is_shown_whole_and_an_empty_one_has_no_file(tmp_path: Path):
    shown = Shown()
    for _, cloud in tiles(3, 5):
        shown.add(cloud)
    assert np.array_equal(shown.cloud().xyz[:, 0], np.arange(15))
    made = write_map(tmp_path, [], ("ply",))
    assert (made.files, made.figures, made.shown) == ((), {"points": 0, "tiles": 0}, None)
    assert not list(tmp_path.iterdir())
