"""Flat maps as picture and YAML, by the convention of ROS's map_server and nav2.

Source: nav2_map_server, map_io.cpp (trinary mode); the map_server page of the ROS wiki.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from pseudolidar.errors import PointFileCorrupt, PointFileMissing, PointFileTruncated
from pseudolidar.formats.atomic import write_group
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.strict_yaml import parse_yaml
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

# Grey values that map_saver writes. Unknown is darkness 50/255 = 0.19608: just above the lower
# threshold of ROS 1, and below nav2's default of 0.25, with which nav2 would call it free.
WHITE, BLACK, GREY = 254, 0, 205
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196
_HEADER = re.compile(rb"P5\s+(?:#[^\n]*\s+)*(\d{1,6})\s+(\d{1,6})\s+255\s")


def write_map_server(path: Path, grid: OccupancyGrid) -> None:
    """Write `path` (.yaml) and its picture, of the same name with .pgm.

    The picture's first row is the largest y. The frame is a comment: the format has none.

    Raises:
        OutputError: they cannot be written.
    """
    picture = path.with_suffix(".pgm")
    write_group({picture: encode_pgm(grid), path: _yaml(grid, picture.name).encode()})


def read_map_server(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> OccupancyGrid:
    """Read a map by nav2's rules for trinary maps, from a YAML and the PGM that it names.

    Raises:
        PointFileMissing: one of them cannot be read.
        PointFileCorrupt: a field that is missing or impossible, a turned map, no PGM.
        PointFileTruncated: the picture is cut.
    """
    text = _read(path).decode(errors="replace")
    documents = parse_yaml(text, path)
    try:
        fields = documents[0].value
        if not isinstance(fields, dict):
            raise TypeError("no fields")
        resolution_m = float(str(fields["resolution"].value))
        x, y, yaw = (float(str(n.value)) for n in fields["origin"].value)  # type: ignore[union-attr]
        high, low = (float(str(fields[f"{k}_thresh"].value)) for k in ("occupied", "free"))
        negate, image = int(str(fields["negate"].value)), str(fields["image"].value)
        plain = yaw == 0 and resolution_m > 0 and all(map(math.isfinite, (x, y, resolution_m)))
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise PointFileCorrupt(
            f"a map without what it needs ({error})",
            want="image, resolution, origin, negate, occupied_thresh, free_thresh",
            path=path,
        ) from error
    if not plain:
        raise PointFileCorrupt("a turned map or no resolution", want="yaw 0", path=path)
    pixels = decode_pgm(_read(path.parent / image), path.parent / image, limits)
    dark = (pixels if negate else 255 - pixels) / 255.0
    cells = np.where(dark > high, OCCUPIED, np.where(dark < low, FREE, UNKNOWN)).astype(np.uint8)
    frame = re.search(r"^# frame: (.+)$", text, re.MULTILINE)
    return OccupancyGrid(cells[::-1].copy(), resolution_m, (x, y), frame[1] if frame else "map")


def encode_pgm(grid: OccupancyGrid) -> bytes:
    """The picture: white is free, black occupied, grey unknown."""
    grey = np.full(256, GREY, np.uint8)
    grey[FREE], grey[OCCUPIED] = WHITE, BLACK
    height, width = grid.cells.shape
    return b"P5\n%d %d\n255\n" % (width, height) + grey[grid.cells[::-1]].tobytes()


def decode_pgm(data: bytes, path: Path, limits: Limits) -> UInt8:
    """(H, W) grey values of a binary PGM of 8 bits."""
    header = _HEADER.match(data)
    if header is None:
        raise PointFileCorrupt(f"{data[:12]!r}", want="a binary PGM of 8 bits", path=path)
    width, height = int(header[1]), int(header[2])
    have = len(data) - header.end()
    if have < width * height or width * height > limits.pixels:
        raise PointFileTruncated(f"{have} pixels", want=f"{width}x{height}", path=path)
    return np.frombuffer(data, np.uint8, width * height, header.end()).reshape(height, width)


def _yaml(grid: OccupancyGrid, picture: str) -> str:
    x, y = grid.origin_m
    return (
        f"# frame: {grid.frame}\n"
        f"image: {picture}\nmode: trinary\nresolution: {grid.resolution_m:.17g}\n"
        f"origin: [{x:.17g}, {y:.17g}, 0.0]\nnegate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n"
    )


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise PointFileMissing(
            error.strerror or str(error), want="a readable map", path=path
        ) from error
