"""A map of any size: squares of ground, of which only those in use are in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.mapping.free_space import FreeSpace
from pseudolidar.mapping.map_points import FramePoints
from pseudolidar.mapping.map_voxels import SUMS, merged, places_of, voxels_of
from pseudolidar.structures.arrays import AnyArray, Float32, Float64
from pseudolidar.structures.cloud import PointCloud

# Sums that wait in memory, of all tiles; more go to their tile's file.
MOST_WAITING = 2_000_000
# Errors of frames that see the same are alike: averages are not surer than this share of one.
SUREST_SHARE = 0.3
Tile = tuple[int, int]


@dataclass(frozen=True)
class MapTiles:
    """How a map is divided.

    Args:
        voxel: points are averaged over cubes of this edge, m.
        tile: edge of a square of ground, m.
        views: points that fewer frames see are left out.
        carve: leave out what later frames see through: trails of what moved, ghosts.
    """

    voxel: float = 0.05
    tile: float = 20.0
    views: int = 2
    carve: bool = True

    def __post_init__(self) -> None:
        for name in ("voxel", "tile"):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise UsageError(f"{value:g} m", want="above 0", where=f"map.{name}")
        if self.tile < self.voxel:
            raise UsageError(
                f"tiles of {self.tile:g} m", want="more than a voxel", where="map.tile"
            )

    def start(self, folder: Path, frame: str = "map") -> TileStore:
        """An empty map.

        Args:
            folder: for files of tiles that are not in memory; it exists.
            frame: coordinate frame of its points: z up.
        """
        return TileStore(self, folder, frame)


class TileStore:
    """A map that grows.

    Args:
        settings: as declared.
        folder: for tiles that are not in memory.
        frame: coordinate frame of the points.
    """

    def __init__(self, settings: MapTiles, folder: Path, frame: str) -> None:
        self._settings, self._folder, self._frame = settings, folder, frame
        self._waiting: dict[Tile, list[AnyArray]] = {}
        self._count = 0
        self._stored: set[Tile] = set()

    def add(self, points: FramePoints, T_map_camera: Float64) -> None:
        """A frame's points, where it was taken.

        Raises:
            OSError: the disk is full or gone.
        """
        if not len(points):
            return
        rows = voxels_of(points, T_map_camera, self._settings.voxel)
        tiles = self._tiles_of(rows)
        for tile in np.unique(tiles, axis=0):
            part = rows[(tiles == tile).all(axis=1)]
            self._waiting.setdefault((int(tile[0]), int(tile[1])), []).append(part)
            self._count += len(part)
        if self._count > MOST_WAITING:
            self._make_room({(int(x), int(y)) for x, y in np.unique(tiles, axis=0)})

    def merged(self, free_space: FreeSpace | None = None) -> Iterator[tuple[Tile, PointCloud]]:
        """The tiles one after the other, each with its points; empty ones are left out.

        Args:
            free_space: what frames saw through; None to keep all.
        """
        for tile in sorted(self._stored | set(self._waiting)):
            rows = merged(self._all_of(tile))
            rows = rows[rows["views"] >= self._settings.views]
            places = places_of(rows, self._settings.voxel)
            if free_space is not None and self._settings.carve and len(rows):
                there = ~free_space.empty(places)
                rows, places = rows[there], places[there]
            if len(rows):
                yield tile, self._cloud(rows, places)

    def _tiles_of(self, rows: AnyArray) -> AnyArray:
        # Whole voxels a tile, so that none lies in two.
        side = max(round(self._settings.tile / self._settings.voxel), 1)
        return np.asarray(rows["cell"][:, :2] // side)

    def _make_room(self, in_use: set[Tile]) -> None:
        """Add up what waits; where that is not enough, write what is not in use, then all."""
        for tile, parts in self._waiting.items():
            self._waiting[tile] = [merged(np.concatenate(parts))]
        self._recount()
        for keep in (in_use, set[Tile]()):
            if self._count <= MOST_WAITING // 2:
                return
            for tile in set(self._waiting) - keep:
                with self._path(tile).open("ab") as file:
                    for part in self._waiting.pop(tile):
                        file.write(part.tobytes())
                self._stored.add(tile)
            self._recount()

    def _recount(self) -> None:
        self._count = sum(len(part) for parts in self._waiting.values() for part in parts)

    def _all_of(self, tile: Tile) -> AnyArray:
        parts = list(self._waiting.get(tile, ()))
        if tile in self._stored:
            parts.insert(0, np.fromfile(self._path(tile), SUMS))
        return np.concatenate(parts)

    def _path(self, tile: Tile) -> Path:
        return self._folder / f"tile_{tile[0]}_{tile[1]}.sums"

    def _cloud(self, rows: AnyArray, places: Float64) -> PointCloud:
        weight = rows["weight"][:, None]
        normals = rows["normal"] / np.maximum(
            np.linalg.norm(rows["normal"], axis=1, keepdims=True), np.float32(1e-12)
        )
        nx, ny, nz = np.ascontiguousarray(normals.T, np.float32)
        return PointCloud(
            places.astype(np.float32),
            self._frame,
            rgb=np.clip(np.rint(rows["rgb"] / weight), 0, 255).astype(np.uint8),
            sigma_m=_sigma_m(rows),
            extra={"nx": nx, "ny": ny, "nz": nz, "views": rows["views"].copy()},
        )


def _sigma_m(rows: AnyArray) -> Float32:
    """(N,) of averages: one view's, lowered by how many there are as far as errors differ."""
    views = rows["views"].astype(np.float64)
    one_view = np.sqrt(views / rows["weight"])
    return np.asarray(one_view * np.sqrt(SUREST_SHARE + (1 - SUREST_SHARE) / views), np.float32)
