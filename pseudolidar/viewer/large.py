"""Clouds that lie still, read from their files: small ones whole, large ones as octrees."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pseudolidar.clouds.merge import merged
from pseudolidar.errors import OutputError
from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.formats.points.point_file import unreadable
from pseudolidar.geometry.cloud_frames import turned_forward
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import COLUMNS
from pseudolidar.viewer.moment import shown_points
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.octree.stored import OctreeStore, key_of, octree_folder
from pseudolidar.viewer.octree.tree import Octree
from pseudolidar.viewer.stills import StillCloud, StillOctree

_log = logging.getLogger(__name__)

# Clouds of more points are drawn as far as a view needs.
MOST_WHOLE = 2_000_000
# No format packs a point into less, bytes: files of fewer bytes hold no large cloud.
LEAST_POINT_BYTES = 2


@dataclass(frozen=True)
class StillClouds:
    """Reads clouds.

    Args:
        store: keeps octrees from one run to the next.
        most_whole: points of a cloud that is sent as it is.
    """

    store: OctreeStore = field(default_factory=lambda: OctreeStore(octree_folder()))
    most_whole: int = MOST_WHOLE

    def read(self, name: str, files: Sequence[Path]) -> StillCloud | StillOctree:
        """The cloud of some files, which are the parts of one.

        Raises:
            PseudolidarError: one of them cannot be read, which it names.
        """
        key = self._key(files)
        if key and (tree := self.store.find(key)) is not None:
            return StillOctree(name, tree)
        clouds = [shown_points(turned_forward(read_cloud(file))) for file in files]
        count = sum(map(len, clouds))
        if not key or count <= self.most_whole:
            return StillCloud(name, _whole(clouds))
        _log.info("%s: %s points, for which an octree is built once", name, f"{count:,}")
        return StillOctree(name, self._built(key, _whole([_needed(c) for c in clouds])))

    def _key(self, files: Sequence[Path]) -> str:
        """Of the octree of some files; "" of files that are too small for a large cloud."""
        try:
            size = sum(file.stat().st_size for file in files)
            return key_of(files) if size > LEAST_POINT_BYTES * self.most_whole else ""
        except OSError as error:
            raise unreadable(Path(error.filename), error) from error

    def _built(self, key: str, cloud: PointCloud) -> Octree:
        """Kept, if it can be."""
        try:
            return self.store.build(key, cloud)
        except OutputError as error:
            _log.warning("%s: the octree is not kept, and built anew next time", error)
            return built(cloud)


def _needed(cloud: PointCloud) -> PointCloud:
    """Without normals and pixels, which nothing is drawn by and which take memory."""
    coloured = {name for names in COLUMNS.values() for name in names}
    extra = {name: column for name, column in cloud.extra.items() if name in coloured}
    return replace(cloud, uv=None, extra=extra, shape=None)


def _whole(clouds: list[PointCloud]) -> PointCloud:
    return clouds[0] if len(clouds) == 1 else merged(clouds)
