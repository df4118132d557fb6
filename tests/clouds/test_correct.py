"""Clouds guided by few beams: what they mend, what they must not touch, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.clouds.correct import GUIDED, Guide, Scan, corrected, guided_depth
from pseudolidar.clouds.correct_graph import Known, SurfaceGraph
from pseudolidar.errors import CalibrationField, NoPairs, ScanMissing, StereoConfig, StructureError
from pseudolidar.formats.points.pcd import read_pcd, write_pcd
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.geometry.triangulation import disparity_from_depth, points_by_q
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose

WIDTH_PX, HEIGHT_PX = 620, 188
BEAM_ROWS = tuple(range(72, 184, 7))  # 16 of them
ERROR = DisparityCorrection(np.array([-0.5, 0.3, 0.2, -0.1, 0.1, 0.05, 0.0, 0.1, 0.0, 0.0]), 0.0)


def rig() -> StereoRig:
    """KITTI-like, half its size, with the LiDAR in the left camera."""
    K = np.array([[360.0, 0.0, 305.0], [0.0, 360.0, 86.0], [0.0, 0.0, 1.0]])
    return StereoRig(
        Camera(K, WIDTH_PX, HEIGHT_PX),
        Camera(K, WIDTH_PX, HEIGHT_PX, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.54, 0, 0])),
        T_left_velodyne=Pose.from_rotation(
            "camera_left", "velodyne", R_BODY_OPTICAL.T, np.zeros(3)
        ),
    )


def road_and_wall() -> np.ndarray:
    """(H, W) disparities: a road 1.65 m below, to a wall 30 m ahead that fills the rest."""
    row = np.arange(HEIGHT_PX, dtype=float)[:, None] + np.zeros(WIDTH_PX)
    road = 0.54 * (row - 86.0) / 1.65
    return np.maximum(road, 360 * 0.54 / 30)


def scan_of(true: np.ndarray, rows=BEAM_ROWS, columns=slice(None, None, 3)) -> LidarScan:
    """Exact points of some rows of the image, in the order of a KITTI file."""
    u = np.arange(WIDTH_PX, dtype=float)[columns]
    turns = []
    for v in rows:
        xyz = points_by_q(true[v, columns], u, np.full(len(u), float(v)), rig())
        turn = xyz @ R_BODY_OPTICAL.T
        azimuth = np.arctan2(turn[:, 1], turn[:, 0]) % (2 * np.pi)
        turns.append(turn[np.argsort(azimuth)])
    return LidarScan(np.concatenate(turns).astype(np.float32))


def frame_of(scan: LidarScan | None) -> StereoFrame:
    image = np.zeros((HEIGHT_PX, WIDTH_PX), np.uint8)
    return StereoFrame(image, image, rig(), "7", 7, 123, scan=scan)


def measured(true: np.ndarray, *, noise_px=0.0, error=ERROR) -> DisparityMap:
    v, u = (a.ravel().astype(float) for a in np.indices(true.shape))
    off = error.offset_px(true.ravel(), u, v, (WIDTH_PX, HEIGHT_PX)).reshape(true.shape)
    noise = noise_px * np.random.default_rng(3).standard_normal(true.shape)
    values = (true + off + noise).astype(np.float32)
    return DisparityMap(values, np.full_like(values, 0.3))


def cloud_of(disparity: DisparityMap, frame: StereoFrame):
    return Reproject(max_range_m=1e4).load()(frame, disparity)


def disparity_error(cloud, true: np.ndarray) -> np.ndarray:
    u, v = np.rint(cloud.uv).astype(int).T
    found = disparity_from_depth(cloud.xyz[:, 2].astype(float), u.astype(float), rig())
    return found - true[v, u]


# --- what few beams mend ----------------------------------------------------------------------


@pytest.mark.parametrize("noise_px", [0.0, 0.3])
def test_four_beams_mend_the_error_of_a_rig(noise_px):
    true = road_and_wall()
    frame = frame_of(scan_of(true))
    cloud = cloud_of(measured(true, noise_px=noise_px), frame)
    moved, figures = corrected(cloud, frame, Scan(beams=4))
    assert np.median(np.abs(disparity_error(cloud, true))) > 0.3
    error = disparity_error(moved, true)
    seen = moved.uv[:, 1] > BEAM_ROWS[0]
    blocks = np.add.reduceat(error[seen], np.arange(0, seen.sum(), WIDTH_PX)) / WIDTH_PX
    assert np.abs(blocks).max() < 0.08  # rows on the whole; each was off by 0.2 to 0.5 px
    assert np.median(np.abs(error[seen])) < 0.06 + 0.7 * noise_px
    assert figures["guide_anchors"] == pytest.approx(4 * 207, abs=8)
    assert (moved.sigma_m < cloud.sigma_m).mean() > 0.9
    # Along the ray and nothing else.
    cosine = (moved.xyz * cloud.xyz).sum(1) / np.linalg.norm(moved.xyz, axis=1)
    np.testing.assert_allclose(cosine, np.linalg.norm(cloud.xyz, axis=1), rtol=1e-5)
    for name in ("uv", "intensity"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(cloud, name))


def test_a_wrong_surface_is_put_right_by_the_beams_that_meet_it():
    """A patch of the wall that was matched 1.5 px off, as no rig's error is."""
    true = road_and_wall()
    frame = frame_of(scan_of(true, rows=range(20, 80, 4)))
    off = measured(true, error=DisparityCorrection(np.zeros(10), 0.0))
    patch = np.zeros(true.shape, bool)
    patch[20:80, 200:330] = True
    off.values[patch] += 1.5
    moved, _ = corrected(cloud_of(off, frame), frame, Scan())
    u, v = np.rint(moved.uv).astype(int).T
    inner = (u > 215) & (u < 315) & (v > 25) & (v < 75)
    assert np.abs(np.median(disparity_error(moved, true)[inner])) < 0.1
    far = (u > 400) & (v < 80)
    assert np.abs(disparity_error(moved, true)[far]).max() < 0.1


def test_points_of_the_scan_that_see_something_else_change_little():
    true = road_and_wall()
    scan = scan_of(true)
    rng = np.random.default_rng(5)
    wrong = rng.random(len(scan)) < 0.15
    nearer = replace(scan, xyz=(scan.xyz * np.where(wrong, 0.75, 1.0)[:, None]).astype(np.float32))
    results = []
    for each in (scan, nearer):
        frame = frame_of(each)
        results.append(corrected(cloud_of(measured(true), frame), frame, Scan(beams=16))[0])
    seen = results[0].uv[:, 1] > BEAM_ROWS[0]
    by_px = np.abs(disparity_error(results[1], true) - disparity_error(results[0], true))[seen]
    assert np.quantile(by_px, 0.95) < 0.1


# --- what they leave alone --------------------------------------------------------------------


def grid(columns: slice, d: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    v, u = np.mgrid[0:HEIGHT_PX:2, columns]
    return u.ravel().astype(float), v.ravel().astype(float), np.full(u.size, d)


def test_nothing_passes_the_edge_of_an_object():
    near, far = grid(slice(0, 300, 2), 30.0), grid(slice(300, 600, 2), 20.0)
    u, v, d = (np.concatenate(pair) for pair in zip(near, far, strict=True))
    is_near = np.arange(len(u)) < len(near[0])
    graph = SurfaceGraph.of(u, v, d, width_px=WIDTH_PX, neighbours=8)
    point = np.flatnonzero(is_near)[::7]
    change, share = graph.spread(Known(point, np.ones(len(point)), np.full(len(point), 0.3)))
    inner = np.abs(u - 300) > WIDTH_PX / 80
    assert change[is_near & inner].min() > 0.95
    assert np.abs(change[~is_near & inner]).max() < 0.05
    assert share[~is_near & inner].max() < 0.05


def test_far_from_all_beams_a_surface_stays():
    u, v, d = grid(slice(0, 600, 2), 20.0)
    graph = SurfaceGraph.of(u, v, d, width_px=WIDTH_PX, neighbours=8)
    point = np.flatnonzero(u < 60)
    change, share = graph.spread(Known(point, np.ones(len(point)), np.full(len(point), 0.3)))
    assert change[u < 40].min() > 0.95
    assert np.abs(change[u > 300]).max() < 0.05
    assert share[u > 300].max() < 0.05
    assert share[u < 40].min() > 0.95


def test_a_scan_that_meets_nothing_leaves_the_cloud_as_it_is():
    true = road_and_wall()
    behind = LidarScan(scan_of(true).xyz * np.float32([-1, 1, 1]))
    for scan in (behind, LidarScan(np.empty((0, 3), np.float32))):
        frame = frame_of(scan)
        cloud = cloud_of(measured(true), frame)
        moved, figures = corrected(cloud, frame, Scan())
        np.testing.assert_array_equal(moved.xyz, cloud.xyz)
        np.testing.assert_array_equal(moved.sigma_m, cloud.sigma_m)
        assert not moved.extra[GUIDED].any()
        assert figures["guide_anchors"] == 0


def test_organised_clouds_and_clouds_without_sigma():
    true = road_and_wall()
    frame = frame_of(scan_of(true))
    holes = measured(true)
    holes.values[::5] = np.nan
    plain = corrected(cloud_of(holes, frame), frame, Scan())[0]
    organised = Reproject(max_range_m=1e4, organised=True).load()(frame, holes)
    moved = corrected(organised, frame, Scan())[0]
    assert moved.shape == true.shape
    np.testing.assert_array_equal(moved.xyz[moved.valid], plain.xyz)
    unsure = corrected(cloud_of(DisparityMap(holes.values), frame), frame, Scan())[0]
    assert unsure.sigma_m is None
    np.testing.assert_allclose(unsure.xyz, plain.xyz, rtol=1e-3)


def test_the_depth_map_follows_the_cloud():
    true = road_and_wall()
    frame = frame_of(scan_of(true))
    holes = measured(true)
    holes.values[::5] = np.nan
    depth = depth_map(holes, frame.rig)
    cloud, guided, _ = Scan().load(frame.rig)(frame, cloud_of(holes, frame), depth)
    u, v = np.rint(cloud.uv).astype(int).T
    np.testing.assert_array_equal(guided.values[v, u], cloud.xyz[:, 2])
    np.testing.assert_array_equal(guided.valid, depth.valid)
    same = guided_depth(depth, cloud_of(holes, frame))
    np.testing.assert_allclose(same.values, depth.values, rtol=1e-6)


def test_nothing_is_done_where_nothing_is_asked_for():
    frame = frame_of(None)
    disparity = measured(road_and_wall())
    cloud, depth = cloud_of(disparity, frame), depth_map(disparity, frame.rig)
    guided = Guide.unused()(frame, cloud, depth)
    assert (guided.cloud, guided.depth, guided.figures) == (cloud, depth, {})


# --- what is refused --------------------------------------------------------------------------


def test_frames_without_scan_or_its_place_are_refused():
    cloud = cloud_of(measured(road_and_wall()), frame_of(None))
    with pytest.raises(ScanMissing, match="frame 7"):
        corrected(cloud, frame_of(None), Scan())
    frame = frame_of(scan_of(road_and_wall()))
    placeless = replace(frame, rig=replace(frame.rig, T_left_velodyne=None))
    with pytest.raises(CalibrationField, match="T_left_velodyne"):
        Scan().load(placeless.rig)
    with pytest.raises(CalibrationField, match="T_left_velodyne"):
        corrected(cloud, placeless, Scan())
    with pytest.raises(StructureError, match="without pixels"):
        corrected(replace(cloud, uv=None), frame, Scan())
    with pytest.raises(StructureError, match="velodyne"):
        corrected(replace(cloud, frame="velodyne"), frame, Scan())
    with pytest.raises(StereoConfig, match="neighbours"):
        Scan(neighbours=1)


# --- at the command line ----------------------------------------------------------------------


def test_convert_guides_by_some_beams_with_the_same_bytes_for_any_workers(tmp_path, capsys):
    source = ["synthetic:street:2", "--source.width-px", "400", "--to", "pcd,mcap"]
    for out, flags in {"plain": [], "1": ["--guide", "scan:4"], "2": ["--guide", "scan:4"]}.items():
        workers = ["--workers", "2" if out == "2" else "1"]
        assert main(["convert", *source, str(tmp_path / out), *flags, *workers]) == 0
    told = capsys.readouterr().out
    assert told.count("LiDAR points a frame") == 2
    for one in sorted((tmp_path / "1").rglob("*.[pm]c*")):
        again = tmp_path / "2" / one.relative_to(tmp_path / "1")
        assert one.read_bytes() == again.read_bytes()
    plain, guided = (read_pcd(tmp_path / o / "pcd" / "000000.pcd") for o in ("plain", "1"))
    assert len(plain) == len(guided)
    share = guided.extra[GUIDED]
    assert share.dtype == np.float32
    assert 0 <= share.min() < 0.2 < 0.8 < share.max() <= 1
    assert GUIDED not in plain.extra
    assert not np.array_equal(plain.xyz, guided.xyz)


def test_sources_without_pairs_or_place_of_a_lidar_are_refused_at_once(tmp_path, capsys):
    frame = frame_of(None)
    (tmp_path / "clouds").mkdir()
    write_pcd(tmp_path / "clouds" / "a.pcd", cloud_of(measured(road_and_wall()), frame))
    command = ["convert", str(tmp_path / "clouds"), str(tmp_path / "out"), "--guide", "scan"]
    assert main(command) == NoPairs.exit_code
    assert "NoPairs" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
