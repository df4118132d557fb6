"""The files of a map: a tile at a time, and the whole made of the files of tiles."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.formats.points.joined import join_clouds
from pseudolidar.mapping.tiles import Tile
from pseudolidar.running.one_cloud import write_cloud
from pseudolidar.structures.arrays import Int64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.occupancy_grid import OccupancyGrid

TILE_FOLDER, WHOLE_NAME = "tiles", "map"
# Pictures and the recording show so many points at most, evenly chosen of a larger map.
MOST_SHOWN = 2_000_000


@dataclass(frozen=True, eq=False)
class Made:
    """What was made along a path.

    Args:
        files: what there is to open.
        figures: of the map.
        shown: points of the map, all or evenly chosen; None of a map without any.
        grid: flat map for robots; None where none was made.
        mesh: one of the mesh's files, to be shown; None where none was made.
    """

    files: tuple[Path, ...] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)
    shown: PointCloud | None = None
    grid: OccupancyGrid | None = None
    mesh: Path | None = None

    def also(self, files: tuple[Path, ...], figures: Mapping[str, Any] | None = None) -> Made:
        """With more files, and more figures."""
        more = {**self.figures, **(figures or {})}
        return replace(self, files=(*self.files, *files), figures=more)


class Shown:
    """A part of a map that memory holds whatever its size: every point, every second, fourth..."""

    def __init__(self) -> None:
        self._parts: list[PointCloud] = []
        self._every, self._met = 1, 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, cloud: PointCloud) -> None:
        """The next tile, not empty."""
        self._parts.append(cloud[_every(len(cloud), -self._met % self._every, self._every)])
        self._met += len(cloud)
        self._low = np.minimum(self._low, cloud.xyz.min(axis=0))
        self._high = np.maximum(self._high, cloud.xyz.max(axis=0))
        while sum(map(len, self._parts)) > MOST_SHOWN:
            self._thin()

    def _thin(self) -> None:
        """Leave out every second of those that are held."""
        begin, parts = 0, []
        for part in self._parts:
            parts.append(part[_every(len(part), begin % 2, 2)])
            begin += len(part)
        self._parts, self._every = parts, 2 * self._every

    def cloud(self) -> PointCloud | None:
        """Those points; None of a map without any."""
        from pseudolidar.clouds.merge import merged

        return merged(self._parts) if self._met else None

    def figures(self) -> dict[str, Any]:
        """Of the map: how many points, how large, and how sure those are that are held."""
        if not self._met:
            return {"points": 0}
        sigmas_m = [part.sigma_m for part in self._parts if part.sigma_m is not None]
        return {
            "points": self._met,
            "extent_m": [float(edge) for edge in self._high - self._low],
            "sigma_m_median": float(np.median(np.concatenate(sigmas_m))),
        }


def _every(count: int, first: int, step: int) -> Int64:
    """Positions, not a slice: a view would hold the whole tile."""
    return np.arange(first, count, step, dtype=np.int64)


def write_map(
    folder: Path, tiles: Iterable[tuple[Tile, PointCloud]], kinds: tuple[str, ...]
) -> Made:
    """Write the map: each tile, and the whole.

    Args:
        folder: output folder.
        tiles: of the map, none empty.
        kinds: formats.

    Raises:
        OutputError: the disk is full or gone.
    """
    tiles_folder = folder / TILE_FOLDER
    shutil.rmtree(tiles_folder, ignore_errors=True)
    shown, names = Shown(), list[str]()
    for (x, y), cloud in tiles:
        shown.add(cloud)
        names.append(f"{x}_{y}")
        for kind in kinds:
            tiles_folder.mkdir(parents=True, exist_ok=True)
            write_cloud(tiles_folder / f"{x}_{y}.{kind}", cloud)
    figures = {**shown.figures(), "tiles": len(names)}
    if not names or not kinds:
        return Made((), figures, shown.cloud())
    wholes = tuple(folder / f"{WHOLE_NAME}.{kind}" for kind in kinds)
    for whole in wholes:
        join_clouds([tiles_folder / f"{name}{whole.suffix}" for name in names], whole)
    return Made((*wholes, tiles_folder), figures, shown.cloud())
