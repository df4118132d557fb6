"""Disparities made one along a path: of a wall, of what moves, of what hides."""

import json
import subprocess
import sys

import numpy as np
import pytest

from pseudolidar.mapping import tiles as tiles_module
from pseudolidar.mapping.free_space import FreeSpace
from pseudolidar.mapping.fusion import TemporalFusion
from pseudolidar.mapping.map_points import FramePoints, MapPoints
from pseudolidar.mapping.map_voxels import SUMS, merged, places_of, voxels_of
from pseudolidar.mapping.tiles import MapTiles
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.pose import Pose

K = np.array([[150.0, 0, 99.5], [0, 150.0, 59.5], [0, 0, 1]])
RIG = StereoRig(
    Camera(K, 200, 120, frame="camera_left"),
    Camera(K, 200, 120, frame="camera_right"),
    Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.5, 0.0, 0.0])),
)
SIGMA_PX = 0.3


def ahead(metres: float) -> np.ndarray:
    T = np.eye(4)
    T[2, 3] = metres
    return T


def wall(depth_m: float, rng: np.random.Generator | None = None) -> DisparityMap:
    """A wall across the way."""
    shape = RIG.left.height_px, RIG.left.width_px
    values = np.full(shape, RIG.fB_px_m / depth_m, np.float32)
    if rng is not None:
        values += rng.normal(0, SIGMA_PX, shape).astype(np.float32)
    return DisparityMap(values, np.full(shape, SIGMA_PX, np.float32))


def test_frames_of_a_wall_agree_more_and_more():
    rng = np.random.default_rng(0)
    fusion = TemporalFusion().start()
    errors = []
    for step in range(10):
        fused = fusion.add(wall(10 - 0.3 * step, rng), RIG, ahead(0.3 * step))
        errors.append(float(np.nanstd(fused.depth_m - (10 - 0.3 * step))))
    assert errors[-1] < 0.5 * errors[0]
    middle = fused.counts[40:80, 60:140]
    assert np.median(middle) >= 9
    normalised = (fused.depth_m - 7.3)[40:80, 60:140] / fused.sigma_m[40:80, 60:140]
    assert 0.6 < normalised.std() < 1.4


def test_what_comes_nearer_begins_anew():
    fusion = TemporalFusion().start()
    for _ in range(5):
        fusion.add(wall(10), RIG, np.eye(4))
    fused = fusion.add(wall(7), RIG, np.eye(4))
    assert fused.counts.max() == 1
    assert np.allclose(fused.depth_m, 7, atol=1e-4)


def test_nothing_is_made_up_where_nothing_is_measured():
    fusion = TemporalFusion().start()
    fusion.add(wall(10), RIG, np.eye(4))
    hole = wall(10)
    hole.values[30:60, 50:90] = np.nan
    fused = fusion.add(hole, RIG, np.eye(4))
    assert np.isnan(fused.inverse_depth[30:60, 50:90]).all()
    assert (fused.counts[30:60, 50:90] == 0).all()
    assert (fused.counts[:30] == 2).all()


def test_movable_things_are_forgotten():
    fusion = TemporalFusion().start()
    masked = np.zeros((120, 200), bool)
    masked[:, :100] = True
    fusion.add(wall(10), RIG, np.eye(4), movable=masked)
    fused = fusion.add(wall(10), RIG, np.eye(4))
    assert (fused.counts[:, :95] == 1).all()
    assert (fused.counts[:, 105:] == 2).all()


@pytest.mark.parametrize(("missed", "kept"), [(2, False), (3, True)])
def test_what_is_masked_but_for_two_frames_leaves_no_point(missed: int, kept: bool):
    """A detector that misses a thing now and then needs no track that coasts."""
    masked = np.zeros((120, 200), np.bool_)
    masked[40:80, 60:140] = True
    rgb, fusion = np.zeros((120, 200, 3), np.uint8), TemporalFusion().start()
    on_it = []
    for number in range(9):
        found = number < 3 or number >= 3 + missed
        fused = fusion.add(wall(10), RIG, np.eye(4), movable=masked if found else None)
        xyz = MapPoints(sigma=1.0).of(fused, rgb).xyz
        column, row = np.rint(xyz[:, :2] / xyz[:, 2:] * 150 + (99.5, 59.5)).astype(int).T
        on_it.append(int(masked[row, column].sum()))
    assert (sum(on_it) > 0) is kept


def test_points_of_a_wall_look_at_the_camera():
    fusion = TemporalFusion().start()
    for _ in range(4):
        fused = fusion.add(wall(5), RIG, np.eye(4))
    rgb = np.full((120, 200, 3), 90, np.uint8)
    points = MapPoints(frames=3, sigma=1.0).of(fused, rgb)
    assert len(points) > 20_000
    assert np.allclose(points.normals, (0, 0, -1), atol=1e-3)
    assert np.allclose(points.xyz[:, 2], 5, atol=1e-4)
    assert len(MapPoints(frames=5, sigma=1.0).of(fused, rgb)) == 0
    assert len(MapPoints(frames=3, sigma=1e-4).of(fused, rgb)) == 0


def points_at(xyz: np.ndarray, sigma_m: float = 0.05) -> FramePoints:
    n = len(xyz)
    normals = np.tile(np.float32([0, 0, -1]), (n, 1))
    rgb = np.full((n, 3), 100, np.uint8)
    return FramePoints(xyz.astype(np.float32), normals, rgb, np.full(n, sigma_m, np.float32))


def test_voxels_hold_means_weighed_by_their_sigma():
    sure, unsure = (
        points_at(np.array([[0.01, 0.01, 1.01]]), 0.01),
        points_at(np.array([[0.03, 0.03, 1.03]]), 0.03),
    )
    rows = merged(
        np.concatenate([voxels_of(each, np.eye(4), 0.05) for each in (sure, unsure, sure)])
    )
    assert len(rows) == 1
    assert rows["views"][0] == 3
    wanted = 0.01 + 0.02 / 19  # weights 9, 1, 9
    assert places_of(rows, 0.05)[0] == pytest.approx((wanted, wanted, 1 + wanted), abs=1e-4)


def test_a_map_is_the_same_whatever_had_to_leave_the_memory(tmp_path, monkeypatch):
    whole, parts = (gathered(tmp_path / name, most, monkeypatch) for name, most in TWO_MEMORIES)
    assert not list((tmp_path / "much").iterdir())
    assert list((tmp_path / "little").iterdir())
    assert whole.keys() == parts.keys()
    for tile, cloud in whole.items():
        assert np.abs(cloud.xyz - parts[tile].xyz).max() < 1e-5
        assert np.array_equal(cloud.extra["views"], parts[tile].extra["views"])
        assert cloud.extra["views"].min() >= 2
        low, high = 5.0 * np.array(tile), 5.0 * np.array(tile) + 5.0
        assert ((cloud.xyz[:, :2] >= low - 1e-4) & (cloud.xyz[:, :2] <= high + 1e-4)).all()


TWO_MEMORIES = (("much", 10**9), ("little", 500))


def gathered(folder, most: int, monkeypatch) -> dict[tuple[int, int], PointCloud]:
    """A map of some hundred points that six frames saw, each a little elsewhere."""
    folder.mkdir()
    monkeypatch.setattr(tiles_module, "MOST_WAITING", most)
    places = np.random.default_rng(1).uniform((-10, -10, 0), (10, 10, 2), (400, 3))
    store = MapTiles(voxel=0.1, tile=5.0, views=2).start(folder)
    for step in range(6):
        T = np.eye(4)
        T[0, 3] = 2.0 * step
        store.add(points_at(places - T[:3, 3] + 0.001 * step), T)
    return dict(store.merged())


def test_what_is_seen_through_is_not_there(tmp_path):
    free = FreeSpace(tmp_path / "free", RIG)
    for step in range(4):
        free.add(np.full((120, 200), 10 - 0.2 * step, np.float32), ahead(0.2 * step))
    ghost, surface, behind = (
        np.array([[0.2, 0.1, 5.0]]),
        np.array([[0.1, 0, 10.0]]),
        np.array([[0.0, 0.0, 14.0]]),
    )
    places = np.concatenate([ghost, surface, behind])
    assert free.empty(places).tolist() == [True, False, False]
    seen, through = free.counts(places)
    assert seen.tolist() == [0, 4, 0]
    assert through.tolist() == [4, 0, 0]
    free.close()


def test_memory_does_not_grow_with_the_drive(tmp_path):
    count = 240
    program = [sys.executable, "-m", "tests.mapping.endless_drive", str(tmp_path), str(count)]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    early, late, merged_all, points = json.loads(done.stdout)
    held_mib = points * SUMS.itemsize / 2**20
    assert held_mib > 40
    assert late - early < 5
    assert merged_all - early < 0.2 * held_mib
