"""Octrees that are kept on disk."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import OutputError
from pseudolidar.formats.checksum import crc32
from pseudolidar.geometry.octree import NODE
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.octree import stored
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.octree.chosen import along
from pseudolidar.viewer.octree.stored import OctreeStore, key_of
from pseudolidar.viewer.stills import StillOctree
from tests.viewer.octree.street import street


def test_an_octree_is_kept_and_found_again(tmp_path: Path):
    store = OctreeStore(tmp_path / "kept")
    assert store.find("a") is None
    made = store.build("a", street())
    found = store.find("a")
    assert found is not None
    assert np.array_equal(found.places, made.places)
    assert found.cube == made.cube
    assert sorted(found.columns) == ["extra.time_s", "rgb", "sigma_m"]
    assert [place.name for place in (tmp_path / "kept").iterdir()] == ["a"]


@pytest.mark.parametrize("name", ["places", "nodes", "rgb", "octree.json"])
@pytest.mark.parametrize("how", ["cut", "changed", "gone"])
def test_a_damaged_one_is_not_found(tmp_path: Path, name: str, how: str):
    store = OctreeStore(tmp_path)
    store.build("a", street(2000))
    file = tmp_path / "a" / name
    data = bytearray(file.read_bytes())
    if how == "gone":
        file.unlink()
    else:
        data[len(data) // 2] ^= 0x55
        file.write_bytes(data[: len(data) // 2] if how == "cut" else data)
    assert store.find("a") is None


def test_one_whose_parts_do_not_belong_together_is_not_found(tmp_path: Path):
    store = OctreeStore(tmp_path)
    store.build("a", street(2000))
    facts = json.loads((tmp_path / "a" / "octree.json").read_bytes())
    for name, dtype in (("sigma_m", np.float32), ("nodes", NODE)):
        file = tmp_path / "a" / name
        before = file.read_bytes()
        array = np.frombuffer(before, dtype).copy()
        if name == "nodes":
            array["count"][-1] -= 1
        data = array[: 2000 - (name == "sigma_m")].tobytes()
        said = {"rows": len(data) // array.itemsize, "crc32": crc32(data, 0)}
        changed = {**facts, "files": {**facts["files"], name: said}}
        file.write_bytes(data)
        (tmp_path / "a" / "octree.json").write_text(json.dumps(changed))
        assert store.find("a") is None
        file.write_bytes(before)
    (tmp_path / "a" / "octree.json").write_text(json.dumps(facts))
    assert store.find("a") is not None


def test_an_empty_cloud_is_kept_too(tmp_path: Path):
    cloud = PointCloud(np.full((3, 3), np.nan), "map", sigma_m=np.zeros(3, np.float32))
    for tree in (OctreeStore(tmp_path).build("a", cloud), built(cloud)):
        assert len(tree) == len(StillOctree("a", tree).coarse().cloud) == 0
        assert len(along(tree, np.zeros(3), np.ones(3))) == 0


def test_two_that_build_the_same_have_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store, write = OctreeStore(tmp_path), stored._write
    first: list[int] = []

    def slowly(folder: Path, cloud: PointCloud) -> None:
        monkeypatch.setattr(stored, "_write", write)
        assert len(store.build("a", street(2000))) == 2000  # by another process
        first.append((tmp_path / "a" / "places").stat().st_ino)
        write(folder, cloud)

    monkeypatch.setattr(stored, "_write", slowly)
    assert len(store.build("a", street(2000))) == 2000
    assert first == [(tmp_path / "a" / "places").stat().st_ino]  # nobody took what is looked at
    assert [place.name for place in tmp_path.iterdir()] == ["a"]


def test_what_cannot_be_marked_as_used_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store = OctreeStore(tmp_path)
    store.build("a", street(2000))

    def refused(_path: Path) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "utime", refused)
    assert store.find("a") is not None


def test_the_longest_unused_ones_make_room(tmp_path: Path):
    OctreeStore(tmp_path).build("first", street(2000))
    one = sum(file.stat().st_size for file in (tmp_path / "first").iterdir())
    store = OctreeStore(tmp_path, most_bytes=int(2.5 * one))
    store.build("second", street(2000))
    os.utime(tmp_path / "first", (1, 1))
    os.utime(tmp_path / "second", (2, 2))
    assert store.find("first") is not None
    (tmp_path / "left.0123abcd.tmp").mkdir()
    os.utime(tmp_path / "left.0123abcd.tmp", (1, 1))
    (tmp_path / "growing.0123abcd.tmp").mkdir()
    store.build("third", street(2000))
    left = {place.name for place in tmp_path.iterdir()}
    assert left == {"first", "third", "growing.0123abcd.tmp"}


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        OctreeStore(tmp_path / "file" / "kept").build("a", street(10))


def test_another_file_has_another_key(tmp_path: Path):
    file = tmp_path / "a.ply"
    file.write_bytes(b"1")
    first = key_of([file])
    os.utime(file, ns=(5, 5))
    assert len({first, key_of([file]), key_of([file, file])}) == 3
