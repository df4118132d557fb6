"""Large clouds: kept on disk, and drawn as far as a view needs."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import OutputError, PointFileMissing
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.points.ply import write_ply
from pseudolidar.geometry.octree import NODE
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.inventory import inventory
from pseudolidar.viewer.large import StillClouds
from pseudolidar.viewer.octree import stored
from pseudolidar.viewer.octree.build import built
from pseudolidar.viewer.octree.chosen import Eye, along, chosen, needs_px, point_sizes_m, within
from pseudolidar.viewer.octree.stored import OctreeStore, key_of
from pseudolidar.viewer.octree.tree import Octree
from pseudolidar.viewer.opening import Opened, Opening
from pseudolidar.viewer.picking import picked
from pseudolidar.viewer.reel import NoFrames
from pseudolidar.viewer.stills import StillCloud, StillOctree, StillPath

UTM_M = np.array([4.5e5, 5.4e6, 110.0])
COUNT = 120_000


def street(count: int = COUNT) -> PointCloud:
    rng = np.random.default_rng(3)
    xyz = UTM_M + rng.uniform((-40, -40, 0), (40, 40, 0.2), (count, 3))
    return PointCloud(
        xyz,
        "map",
        rgb=rng.integers(0, 255, (count, 3), dtype=np.uint8),
        sigma_m=rng.random(count, np.float32),
        extra={"time_s": np.arange(count), "nx": np.zeros(count, np.float32)},
    )


@pytest.fixture(scope="module")
def tree() -> Octree:
    return built(street())


def eye(*, height_m: float, aside_m: float = 0.0) -> Eye:
    """Looks straight down."""
    found = Eye.of(
        wxyz=np.array([0.0, 1.0, 0.0, 0.0]),
        position_m=np.array([aside_m, 0.0, height_m]),
        fov=1.0,
        width_px=1200,
        height_px=800,
        T_map_scene=np.block([[np.eye(3), UTM_M[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]),
    )
    assert found is not None
    return found


def test_places_and_columns_are_those_of_the_cloud(tree: Octree):
    cloud, found = street(), tree.cloud(range(len(tree.nodes)))
    rows = found.extra["time_s"].astype(int)
    assert np.array_equal(np.sort(rows), np.arange(COUNT))
    assert np.abs(found.xyz - cloud.xyz[rows]).max() < 1e-5
    assert found.rgb is not None
    assert cloud.rgb is not None
    assert np.array_equal(found.rgb, cloud.rgb[rows])
    assert np.array_equal(found.sigma_m, cloud.sigma_m[rows])
    assert "nx" not in found.extra


def test_what_is_sent_is_exact_to_half_a_millimetre_on_earth(tree: Octree):
    cloud = street()
    for number in range(len(tree.nodes)):
        rows = tree.cloud([number]).extra["time_s"].astype(int)
        small = tree.half_m[number] <= 2.0
        sent = tree.spread_m(number).astype(np.float16 if small else np.float32)
        # Browsers add positions of nodes, relative to the middle of the map, in float32.
        node = (tree.middles_m[number] - UTM_M).astype(np.float32)
        drawn = node.astype(np.float64) + sent.astype(np.float64) + UTM_M
        assert np.abs(drawn - cloud.xyz[rows]).max() < 1e-3


def test_boxes_hold_what_is_in_nodes_and_below_them(tree: Octree):
    middles, halves = tree.boxes_m
    xyz = street().xyz
    assert np.allclose(middles[0] + halves[0], xyz.max(axis=0), atol=1e-4)
    assert np.allclose(middles[0] - halves[0], xyz.min(axis=0), atol=1e-4)
    assert (halves[:, 2] < 0.11).all()  # a street is flat, whatever cubes it lies in


def test_nodes_know_what_they_are_part_of(tree: Octree):
    parents = tree.parents
    assert (parents[tree.nodes["level"] == 0] == -1).all()
    inner = np.flatnonzero(parents >= 0)
    assert len(inner) == len(tree.nodes) - 1
    away = np.abs(tree.middles_m[inner] - tree.middles_m[parents[inner]])
    assert (away <= tree.half_m[parents[inner], None]).all()


def test_coarse_nodes_come_before_what_lies_in_them(tree: Octree):
    for height_m in (2.0, 15.0, 300.0):
        needs = needs_px(tree, eye(height_m=height_m))
        inner = tree.parents >= 0
        assert (needs[inner] <= needs[tree.parents[inner]]).all()


def test_near_views_are_fine_and_far_ones_coarse(tree: Octree):
    counts = tree.nodes["count"]
    near, far = (chosen(needs_px(tree, eye(height_m=h)), counts, COUNT) for h in (5.0, 20_000.0))
    assert tree.nodes["level"][near].max() == tree.nodes["level"].max()
    assert len(far) == 0
    # Above a corner only what is near it is drawn finely.
    corner = chosen(needs_px(tree, eye(height_m=5.0, aside_m=38.0)), counts, COUNT)
    fine = corner[tree.nodes["level"][corner] == tree.nodes["level"].max()]
    assert len(fine)
    assert (tree.boxes_m[0][fine][:, 0] > UTM_M[0]).all()


@pytest.mark.parametrize("budget", [0, 30_000, 70_000])
def test_the_budget_is_kept(tree: Octree, budget: int):
    needs = needs_px(tree, eye(height_m=20.0))
    drawn = chosen(needs, tree.nodes["count"], budget)
    assert tree.nodes["count"][drawn].sum() <= budget


def test_nodes_that_the_eye_is_in_are_needed_equally(tree: Octree):
    inside = Eye(UTM_M + np.array([20.0, 13.0, 0.05]), np.diag([1.0, -1.0, -1.0]), 1.0, 1.5, 800)
    middles, halves = tree.boxes_m
    holding = (np.abs(inside.position_m - middles) < halves).all(axis=1)
    assert holding.sum() > 1
    # As if their points were a quarter of half an edge away.
    away_m = 0.25 * tree.half_m[holding]
    apart_m = 2 * tree.cube.spacing_m(tree.nodes["level"][holding])
    assert np.allclose(needs_px(tree, inside)[holding], apart_m * inside.focal_px / away_m)


def test_nodes_behind_the_eye_are_left_out(tree: Octree):
    up = Eye(UTM_M + np.array([0, 0, 5.0]), np.eye(3), 1.0, 1.5, 800)
    assert not within(tree, up.sides()).any()
    assert within(tree, eye(height_m=5.0).sides()).any()


def test_points_are_as_large_as_gaps_between_them(tree: Octree):
    every = np.arange(len(tree.nodes))
    alone, together = point_sizes_m(tree, every[:1]), point_sizes_m(tree, every)
    assert alone[0] == pytest.approx(tree.cube.spacing_m(tree.nodes["level"][:1])[0])
    assert together[0] < alone[0]
    between_m = 80 / np.sqrt(COUNT)
    assert np.median(together) == pytest.approx(between_m, rel=0.5)


def test_a_click_finds_the_point_that_all_points_would_give(tree: Octree):
    every = tree.cloud(range(len(tree.nodes)))
    rng = np.random.default_rng(1)
    for _ in range(25):
        origin = UTM_M + rng.uniform((-60, -60, 0.05), (60, 60, 9))
        direction = every.xyz[rng.integers(COUNT)] - origin
        numbers = along(tree, origin, direction)
        want = picked({"all": (every, np.eye(4))}, origin, direction)
        found = picked({"some": (tree.cloud(numbers.tolist()), np.eye(4))}, origin, direction)
        assert want is not None
        assert found is not None
        assert np.array_equal(found.xyz_m, want.xyz_m)


def test_stray_points_are_clicked_and_seen_too():
    cloud = street(30_000)
    xyz = cloud.xyz.copy()
    xyz[17] = 0  # 5 400 km away
    tree = built(PointCloud(xyz, "map"))
    assert (np.abs(tree.places).max(axis=1) > 1000).sum() == 1
    origin, direction = np.array([0.0, 0.0, 50.0]), np.array([0.0, 0.0, -1.0])
    numbers = along(tree, origin, direction)
    found = picked({"some": (tree.cloud(numbers.tolist()), np.eye(4))}, origin, direction)
    assert found is not None
    assert np.abs(found.xyz_m).max() < 1
    above = Eye(origin, np.diag([1.0, -1.0, -1.0]), 1.0, 1.5, 800)
    holds = [
        number for number in range(len(tree.nodes)) if np.abs(tree.spread_m(number)).max() > 1000
    ]
    assert within(tree, above.sides())[holds].all()


def test_a_click_looks_through_few_nodes(tree: Octree):
    corner = UTM_M + np.array([35.0, 35.0, 8.0])
    # The root, and the two nodes that share the corner: the cube's middle is within the street.
    assert along(tree, corner, np.array([0.0, 0.0, -1.0])).tolist() == [0, 7, 8]
    assert along(tree, corner, np.array([0.0, 0.0, 1.0])).tolist() == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"wxyz": np.zeros(4)},
        {"fov": float("nan")},
        {"height_px": 0},
        {"width_px": -4},
        {"position_m": np.array([np.inf, 0, 0])},
    ],
)
def test_cameras_that_are_none_see_nothing(wrong: dict):
    said = {
        "wxyz": np.array([1.0, 0, 0, 0]),
        "position_m": np.zeros(3),
        "fov": 1.0,
        "width_px": 100,
        "height_px": 100,
    }
    assert Eye.of(**{**said, **wrong}, T_map_scene=np.eye(4)) is None


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


def test_what_goes_into_one_file_keeps_all_but_fine_points(tree: Octree):
    path = StillPath("path", np.zeros((2, 3)))
    opened = Opened((NoFrames(),), (StillOctree("a", tree), path), {"000000": ()})
    whole = opened.in_one_file()
    assert (whole.reels, whole.objects, whole.stills[1]) == (opened.reels, {"000000": ()}, path)
    assert isinstance(whole.stills[0], StillCloud)
    assert len(whole.stills[0].cloud) == COUNT
    told = inventory(opened)
    assert told[0] == {"name": "", "kind": "sequence", "frames": 1, "with_objects": 0}
    assert told[1:] == [
        {"name": "a", "kind": "cloud", "points": COUNT},
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
