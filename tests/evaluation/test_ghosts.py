"""The measure of ghosts, checked by ghosts and good points that were put there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import ReferenceMissing, StructureError
from pseudolidar.evaluation.ghosts import GHOST_M, GHOST_REL, GhostCount, judge_points
from pseudolidar.evaluation.scan_surface import ScanSurface
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose

EVERYTHING = Reproject(max_range_m=1e4).load()
FOCAL_PX = 700.0
SIZE = (400, 160)


def rig() -> StereoRig:
    K = np.array([[FOCAL_PX, 0, 200.0], [0, FOCAL_PX, 80.0], [0, 0, 1]])
    right = Camera(K, *SIZE, frame="camera_right")
    shift = Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.5, 0, 0]))
    return StereoRig(Camera(K, *SIZE), right, shift)


def depth_of_scene(u, v):
    """A wall at 20 m, a board 4 m wide at 12 m before it, the road in front of both."""
    depth = np.full(np.broadcast(u, v).shape, 20.0)
    depth = np.where((np.abs(u - 200) < 117) & (v < 100), 12.0, depth)
    with np.errstate(divide="ignore"):
        return np.where(v > 80, np.minimum(depth, FOCAL_PX * 1.6 / (v - 80.0)), depth)


def scanned() -> StereoFrame:
    """The scene seen by beams 0.4 degrees apart from row to row."""
    v, u = np.meshgrid(np.arange(0, SIZE[1], 5.0), np.arange(0, SIZE[0], 2.0), indexing="ij")
    depth = depth_of_scene(u, v)
    rays = np.stack([(u - 200) / FOCAL_PX, (v - 80) / FOCAL_PX, np.ones_like(u)], axis=-1)
    points = (rays * depth[..., None]).reshape(-1, 3).astype(np.float32)
    image = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    scan = LidarScan(points, frame="camera_left")
    return StereoFrame(image, image, rig(), "0", 0, 0, scan=scan)


def cloud_at(u, v, depth) -> PointCloud:
    u, v, depth = (np.asarray(a, np.float64) for a in np.broadcast_arrays(u, v, depth))
    xyz = np.stack([(u - 200) / FOCAL_PX * depth, (v - 80) / FOCAL_PX * depth, depth], axis=1)
    uv = np.stack([u, v], axis=1).astype(np.float32)
    return PointCloud(xyz.astype(np.float32), "camera_left", uv=uv)


def judged(cloud, frame=None):
    pair = scanned() if frame is None else frame
    return judge_points(cloud, pair, ScanSurface.of(pair))


def test_points_between_beams_are_on_the_surface():
    v, u = np.mgrid[8:150, 8:390].reshape(2, -1)
    found = judged(cloud_at(u, v, depth_of_scene(u, v)))
    assert found.judged.mean() > 0.95
    flat = found.judged & (v < 95) & (np.abs(np.abs(u - 200) - 117) > 3)
    assert found.distance_m[flat].max() < 1e-3
    assert found.along_ray_m[flat].max() < 1e-3
    assert not found.ghost.any()
    assert not found.stray.any()


def test_a_trail_between_board_and_wall_is_seen():
    """Beside the board's edge, 12 to 20 m: strays all but where they are within the tolerance."""
    depth = np.linspace(12, 20, 17)
    for beside_px in (8, 20):
        found = judged(cloud_at(200 + 117 + beside_px, np.arange(20.0, 37.0), depth))
        limit = GHOST_M + GHOST_REL * found.range_m
        board_counts = beside_px < FOCAL_PX * 0.25 / 12
        off = np.abs(depth - 20) * found.range_m / depth
        if board_counts:
            off = np.minimum(off, np.abs(depth - 12) * found.range_m / depth)
        np.testing.assert_allclose(found.along_ray_m, off, atol=0.1)
        assert np.array_equal(found.stray, off > limit)
        assert found.stray.sum() >= 10


def test_no_surface_is_stretched_over_a_jump():
    frame = scanned()
    middle = ScanSurface.of(frame)
    corners = middle.points[middle.triangles]
    spread = np.ptp(corners[..., 2], axis=1)
    high = (corners[..., 1] < 0.2).all(axis=1)
    assert high.sum() > 3000
    assert spread[high].max() < 1e-3


def test_points_beside_the_scan_and_without_beams_around_are_not_judged():
    frame = scanned()
    keep = ~((frame.scan.xyz[:, 2] > 15) & (frame.scan.xyz[:, 0] > 0))  # the wall on the right
    holed = replace(frame, scan=LidarScan(frame.scan.xyz[keep], frame="camera_left"))
    found = judged(cloud_at([380.0, 60.0], [20.0, 20.0], [5.0, 5.0]), holed)
    assert found.judged.tolist() == [False, True]
    assert found.ghost.tolist() == [False, True]
    assert found.stray.tolist() == [False, True]


def test_ghosts_are_counted_by_their_own_range():
    before = judged(cloud_at([60.0, 61.0, 62.0, 63.0], [30.0] * 4, [20.0, 14.0, 45.0, 20.5]))
    assert before.counts() == (GhostCount(1, 2), GhostCount(1, 0))
    assert before.counts(strays=True) == (GhostCount(1, 2), GhostCount(1, 0))
    total = GhostCount.total(before.counts())
    assert total == GhostCount(2, 2)


def test_ground_truth_acquits_what_the_scan_missed():
    frame = scanned()
    truth = np.full((SIZE[1], SIZE[0]), np.nan, np.float32)
    truth[30, 60] = FOCAL_PX * 0.5 / 8.0
    pole = cloud_at([60.0, 200.0], [30.0, 30.0], [8.0, 8.0])
    assert judged(pole).stray.tolist() == [True, True]
    known = replace(frame, truth=DisparityMap(truth))
    assert judged(pole, known).stray.tolist() == [False, True]


def test_a_rendered_street_has_few_ghosts_and_injected_ones_are_found():
    source = Synthetic("street", frames=1, width_px=621).open()
    frame = replace(source.load(0), truth=None)
    exact = source.truth_pair(0).left
    surface = ScanSurface.of(frame)
    good = judge_points(EVERYTHING(frame, exact), frame, surface)
    near = good.judged & (good.range_m < 30)
    assert near.sum() > 30_000
    assert good.ghost[near].mean() < 1e-4
    assert good.stray[near].mean() < 0.01  # thin things between beams
    far = good.judged & (good.range_m >= 30) & (good.range_m < 80)
    assert good.stray[far].mean() < 0.05
    # Nearer by a third: in the air before every surface, but for the road, where rays are flat.
    moved = EVERYTHING(frame, DisparityMap(exact.values * np.float32(1.5)))
    wrong = judge_points(moved, frame, surface)
    upright = moved.xyz[:, 1] < 0.8
    chosen = wrong.judged & (wrong.range_m < 30) & upright & (good.range_m > 12)
    assert chosen.sum() > 5_000
    assert wrong.stray[chosen].mean() > 0.9


def test_clouds_that_cannot_be_judged_are_refused():
    frame = scanned()
    with pytest.raises(ReferenceMissing):
        ScanSurface.of(replace(frame, scan=None))
    cloud = cloud_at([60.0], [30.0], [20.0])
    surface = ScanSurface.of(frame)
    for wrong in (replace(cloud, uv=None), replace(cloud, frame="velodyne")):
        with pytest.raises(StructureError):
            judge_points(wrong, frame, surface)
