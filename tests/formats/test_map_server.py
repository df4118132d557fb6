import numpy as np
import pytest

from pseudolidar.errors import PointFileCorrupt, PointFileMissing, PointFileTruncated
from pseudolidar.formats.distance_field import write_distance_field
from pseudolidar.formats.map_server import read_map_server, write_map_server
from pseudolidar.structures.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


@pytest.fixture
def corner() -> OccupancyGrid:
    """Three rows of four cells: an obstacle where x is largest and y least."""
    cells = np.full((3, 4), FREE, np.uint8)
    cells[0, 3], cells[2, 0] = OCCUPIED, UNKNOWN
    return OccupancyGrid(cells, 0.5, (-1.25, 7.0), "map")


def nav2_cells(folder) -> tuple[np.ndarray, dict[str, str]]:
    """What nav2 makes of it, by its rules written out again."""
    lines = [line for line in (folder / "m.yaml").read_text().splitlines() if line[0] != "#"]
    fields = dict(line.split(": ", 1) for line in lines)
    kind, size, most, pixels = (folder / fields["image"]).read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    assert (kind, most, fields["mode"]) == (b"P5", b"255", "trinary")
    cells = np.full(width * height, -1)
    for index, pixel in enumerate(pixels):
        dark = (255 - pixel) / 255.0
        row = height - 1 - index // width  # pictures begin with the largest y
        if dark > float(fields["occupied_thresh"]):
            cells[row * width + index % width] = 100
        elif dark < float(fields["free_thresh"]):
            cells[row * width + index % width] = 0
    return cells.reshape(height, width), fields


def test_nav2_finds_obstacles_where_they_are(corner, tmp_path):
    write_map_server(tmp_path / "m.yaml", corner)
    cells, fields = nav2_cells(tmp_path)
    assert cells[0].tolist() == [0, 0, 0, 100]
    assert cells[2].tolist() == [-1, 0, 0, 0]
    assert fields["origin"] == "[-1.25, 7, 0.0]"
    assert float(fields["resolution"]) == 0.5


def test_a_map_comes_back_as_it_was(corner, tmp_path):
    write_map_server(tmp_path / "m.yaml", corner)
    back = read_map_server(tmp_path / "m.yaml")
    assert np.array_equal(back.cells, corner.cells)
    assert (back.origin_m, back.resolution_m, back.frame) == ((-1.25, 7.0), 0.5, "map")


def test_cut_or_missing_files_are_named(corner, tmp_path):
    path = tmp_path / "m.yaml"
    with pytest.raises(PointFileMissing):
        read_map_server(path)
    write_map_server(path, corner)
    whole = (tmp_path / "m.pgm").read_bytes()
    (tmp_path / "m.pgm").write_bytes(whole[:-1])
    with pytest.raises(PointFileTruncated, match="11 pixels"):
        read_map_server(path)
    path.write_text("image: m.pgm\nresolution: 0.5\n")
    with pytest.raises(PointFileCorrupt, match="origin"):
        read_map_server(path)


def test_the_distance_field_knows_the_way_to_the_obstacle(corner, tmp_path):
    write_distance_field(tmp_path / "d.npz", corner)
    field = np.load(tmp_path / "d.npz")
    assert field["distance_m"][0].tolist() == [1.5, 1.0, 0.5, 0.0]
    assert np.isnan(field["distance_m"][2, 0])
    assert field["distance_m"][2, 3] == 1.0
    assert field["origin_m"].tolist() == [-1.25, 7.0]
