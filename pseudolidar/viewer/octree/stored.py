"""Octrees kept on disk between runs: in the user's cache, found by what they were built of."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.formats.atomic import (
    fsync_folder,
    is_temporary,
    output_error,
    temporary_beside,
    write_all,
)
from pseudolidar.formats.checksum import crc32
from pseudolidar.geometry.octree import NODE, OctreeCube, octree_order
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.octree.build import column, columns_of, places
from pseudolidar.viewer.octree.tree import RGB, Octree

_log = logging.getLogger(__name__)

CACHE_VARIABLE, FOLDER = "XDG_CACHE_HOME", "pseudolidar/octrees"
# Part of every key: octrees of an older form are not found.
FORM = 2
# What all octrees may hold; the longest unused go first. What a killed run left goes after a day.
MOST_BYTES, LEFT_S = 8 << 30, 86_400.0
FACTS, NODES, PLACES = "octree.json", "nodes", "places"
CHECKED_BYTES = 1 << 24
# What files raise that are not what was written.
DAMAGED = (OSError, ValueError, TypeError, KeyError, AttributeError)
# Files that hold something other than one float32 a point.
FORMS: dict[str, tuple[np.dtype[Any], tuple[int, ...]]] = {
    NODES: (NODE, ()),
    PLACES: (np.dtype("<f4"), (3,)),
    RGB: (np.dtype("u1"), (3,)),
}


def octree_folder() -> Path:
    """Where octrees of this user are kept."""
    if given := os.environ.get(CACHE_VARIABLE):
        return Path(given) / FOLDER
    with contextlib.suppress(RuntimeError):  # no home folder
        return Path.home() / ".cache" / FOLDER
    return Path(tempfile.gettempdir()) / f"pseudolidar-octrees-{os.getuid()}"


def key_of(files: Sequence[Path]) -> str:
    """Name of the octree of some files: other content, other times or another place make another.

    Raises:
        OSError: one of them is gone.
    """
    said = [str(FORM)]
    for file in files:
        facts = file.stat()
        said.append(f"{file.resolve()}\0{facts.st_size}\0{facts.st_mtime_ns}")
    return hashlib.sha256("\n".join(said).encode()).hexdigest()[:32]


@dataclass(frozen=True)
class OctreeStore:
    """Octrees on disk.

    Args:
        folder: theirs alone.
        most_bytes: what all of them may hold.
    """

    folder: Path
    most_bytes: int = MOST_BYTES

    def find(self, key: str) -> Octree | None:
        """An octree, its files mapped into memory; None where there is none, or a damaged one."""
        place = self.folder / key
        try:
            tree = _read(place)
        except FileNotFoundError:
            return None
        except DAMAGED as error:
            _log.warning("%s: a damaged octree is built anew (%s)", place, error)
            return None
        with contextlib.suppress(OSError):  # a cache that cannot be written can be read
            os.utime(place)
        return tree

    def build(self, key: str, cloud: PointCloud) -> Octree:
        """Build an octree, keep it, and forget the longest unused ones that there is no room for.

        Raises:
            OutputError: the disk is full or gone.
        """
        place = self.folder / key
        temporary = temporary_beside(place)
        try:
            temporary.mkdir(parents=True)
            _write(temporary, cloud)
            _name(temporary, place)
            fsync_folder(self.folder)
        except OSError as error:
            raise output_error(place, error) from error
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
        self._make_room(keep=place)
        found = self.find(key)
        if found is None:
            raise output_error(place, OSError("what was written cannot be read"))
        return found

    def _make_room(self, keep: Path) -> None:
        """Remove what is over the budget, and what killed runs left."""
        left = self.most_bytes - _bytes_of(keep)
        others = [place for place in self.folder.iterdir() if place != keep and place.is_dir()]
        for place in sorted(others, key=_used_s, reverse=True):
            left -= _bytes_of(place)
            # Another process may be writing what has no name yet.
            growing = is_temporary(place.name) and time.time() - _used_s(place) < LEFT_S
            if not growing and (left < 0 or is_temporary(place.name)):
                shutil.rmtree(place, ignore_errors=True)


def _read(place: Path) -> Octree:
    """An octree of a folder; raises one of `DAMAGED` where it is not whole."""
    facts = json.loads((place / FACTS).read_bytes())
    arrays = {name: _mapped(place, name, facts) for name in facts["files"]}
    cube, frame = OctreeCube(**facts["cube"]), str(facts["frame"])
    tree = Octree(cube, frame, arrays.pop(NODES), arrays.pop(PLACES), arrays)
    _check(tree)
    return tree


def _name(temporary: Path, place: Path) -> None:
    """Give an octree its name, unless another process was faster; a damaged one makes room."""
    try:
        temporary.rename(place)
    except OSError:
        try:
            _read(place)
        except DAMAGED:
            shutil.rmtree(place, ignore_errors=True)
            temporary.rename(place)


def _write(folder: Path, cloud: PointCloud) -> None:
    found = octree_order(cloud.xyz)
    files: dict[str, Any] = {NODES: _written(folder / NODES, [found.nodes])}
    files[PLACES] = _written(folder / PLACES, places(found, cloud))
    for name, values in columns_of(cloud).items():
        files[name] = _written(folder / name, column(found, values))
    facts = {"cube": asdict(found.cube), "frame": cloud.frame, "files": files}
    _written(folder / FACTS, [np.frombuffer(json.dumps(facts).encode(), np.uint8)])


def _written(path: Path, parts: Iterator[AnyArray] | Sequence[AnyArray]) -> dict[str, Any]:
    """Write an array part by part; how long it is, and its checksum."""
    rows, checksum = 0, 0
    with path.open("xb") as file:
        for part in parts:
            data = _bytes(part)
            write_all(file, data)
            rows, checksum = rows + len(part), crc32(data, checksum)
        file.flush()
        os.fsync(file.fileno())
    return {"rows": rows, "crc32": checksum}


def _mapped(folder: Path, name: str, facts: dict[str, Any]) -> AnyArray:
    """An array of a file.

    Raises:
        ValueError: it has not the size or the content that was written.
        OSError: it cannot be read.
    """
    said = facts["files"][name]
    dtype, width = FORMS.get(name, (np.dtype("<f4"), ()))
    shape = (int(said["rows"]), *width)
    path = folder / Path(name).name
    # An empty file cannot be mapped.
    mapped = np.memmap(path, dtype, "r", shape=shape) if shape[0] else np.zeros(shape, dtype)
    array: AnyArray = mapped
    data, checksum = _bytes(array), 0
    for start in range(0, len(data), CHECKED_BYTES):
        checksum = crc32(data[start : start + CHECKED_BYTES], checksum)
    whole = path.stat().st_size == array.nbytes
    if not whole or checksum != said["crc32"]:
        raise ValueError(f"{name} is not what was written")
    return array


def _bytes(array: AnyArray) -> memoryview:
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


def _check(tree: Octree) -> None:
    """Raise `ValueError` where nodes and points do not belong together."""
    lengths = {len(tree), *map(len, tree.columns.values())}
    ends = tree.nodes["start"] + tree.nodes["count"]
    if len(lengths) != 1 or (len(ends) and int(ends.max()) != len(tree)):
        raise ValueError("columns of several lengths")


def _bytes_of(folder: Path) -> int:
    with contextlib.suppress(OSError):
        return sum(file.stat().st_size for file in folder.iterdir())
    return 0


def _used_s(folder: Path) -> float:
    with contextlib.suppress(OSError):
        return folder.stat().st_mtime
    return 0.0
