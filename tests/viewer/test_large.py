"""Large clouds become octrees when they are opened."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import PointFileMissing
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.viewer.inventory import inventory
from pseudolidar.viewer.large import StillClouds
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.octree.stored import OctreeStore
from pseudolidar.viewer.opening import Opened, Opening
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.stills import StillCloud, StillOctree, StillPath
from tests.viewer.octree.street import street


def clouds(tmp_path: Path) -> StillClouds:
    return StillClouds(OctreeStore(tmp_path / "kept"), most_whole=1000)


def test_large_clouds_become_octrees_once(tmp_path: Path):
    write_ply(tmp_path / "large.ply", street(3000))
    write_ply(tmp_path / "small.ply", street(900))
    read = clouds(tmp_path)
    first = read.read("large", [tmp_path / "large.ply"])
    assert isinstance(first, StillOctree)
    assert first.amount.startswith("3,000 points")
    assert isinstance(read.read("small", [tmp_path / "small.ply"]), StillCloud)
    (kept,) = (tmp_path / "kept").iterdir()
    before = (kept / "places").stat().st_ino
    assert isinstance(read.read("large", [tmp_path / "large.ply"]), StillOctree)
    assert (kept / "places").stat().st_ino == before
    (kept / "places").write_bytes(b"")
    assert isinstance(read.read("large", [tmp_path / "large.ply"]), StillOctree)
    assert (kept / "places").stat().st_size == 3000 * 12


def test_a_cache_that_cannot_be_written_refuses_no_view(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    write_ply(tmp_path / "large.ply", street(3000))
    (tmp_path / "kept").write_text("")
    still = clouds(tmp_path).read("large", [tmp_path / "large.ply"])
    assert isinstance(still, StillOctree)
    assert len(still.tree) == 3000
    assert "is not kept" in caplog.text


def test_a_file_that_is_gone_is_named(tmp_path: Path):
    with pytest.raises(PointFileMissing, match=r"gone\.ply"):
        clouds(tmp_path).read("gone", [tmp_path / "gone.ply"])


def test_the_squares_of_a_map_are_one_cloud(tmp_path: Path):
    (tmp_path / "tiles").mkdir()
    (tmp_path / "run.json").write_text("{}")
    parts = street(3000)
    for number, name in enumerate(("0_0", "0_-1", "12_3")):
        write_ply(tmp_path / "tiles" / f"{name}.ply", parts[slice(number, None, 3)])
    for path in (tmp_path, tmp_path / "tiles"):
        opening = Opening(lambda _source: NoFrames(), clouds=clouds(tmp_path))
        (still,) = opening.all_of([str(path)]).stills
        assert isinstance(still, StillOctree)
        assert still.name == "tiles"
        assert len(still.tree) == 3000


def test_what_goes_into_one_file_keeps_all_but_fine_points():
    tree = built(street(3000))
    path = StillPath("path", np.zeros((2, 3)))
    opened = Opened((NoFrames(),), (StillOctree("a", tree), path), {"000000": ()})
    whole = opened.in_one_file()
    assert (whole.reels, whole.objects, whole.stills[1]) == (opened.reels, {"000000": ()}, path)
    assert isinstance(whole.stills[0], StillCloud)
    assert len(whole.stills[0].cloud) == 3000
    told = inventory(opened)
    assert told[0] == {"name": "", "kind": "sequence", "frames": 1, "with_objects": 0}
    assert told[1:] == [
        {"name": "a", "kind": "cloud", "points": 3000},
        {"name": "path", "kind": "path", "poses": 2, "length_m": 0.0},
    ]


def test_files_of_one_name_are_told_apart(tmp_path: Path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_ply(tmp_path / folder / "map.ply", street(10))
    opened = Opening(lambda _source: NoFrames()).all_of(
        [str(tmp_path / folder / "map.ply") for folder in ("a", "b")]
    )
    assert [still.name for still in opened.stills] == ["map.ply", "map.ply (2)"]
