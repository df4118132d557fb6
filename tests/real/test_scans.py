"""LiDAR scans of KITTI: the chain to the camera, motion, tilt, and clouds against them."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.geometry.projection import Occluders, project, project_scan
from pseudolidar.geometry.scan_motion import raised
from pseudolidar.geometry.triangulation import disparity_from_depth
from pseudolidar.sources.kitti.object import KittiObject
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.structures.frame import LidarScan

pytestmark = pytest.mark.real
DATE, DRIVE = "2011_09_26", "2011_09_26_drive_0002_sync"


def rows_of(path: Path) -> dict[str, np.ndarray]:
    """The numbers of a calibration file by key, read without this package."""
    fields = (line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    found = {}
    for key, values in fields:
        try:
            found[key] = np.array(values.split(), float)
        except ValueError:
            continue  # a date
    return found


def square(values: np.ndarray) -> np.ndarray:
    """(4, 4) of a rotation (9) or of a rigid motion's first rows (12)."""
    matrix = np.eye(4)
    side = values.reshape(3, -1)
    matrix[:3, : side.shape[1]] = side
    return matrix


def devkit_pixels(xyz: np.ndarray, P: np.ndarray, *chain: np.ndarray) -> np.ndarray:
    """P_rect R_rect T_velo_cam X, as run_demoVelodyne.m of the development kit has it."""
    matrix = P.reshape(3, 4)
    for link in chain:
        matrix = matrix @ link
    seen = np.c_[xyz, np.ones(len(xyz))] @ matrix.T
    return seen[:, :2] / seen[:, 2:]


def ours(frame, xyz):
    uv, _ = project(frame.rig.T_left_velodyne.apply(xyz), frame.rig.P_left)
    return uv


def ahead(scan: LidarScan) -> np.ndarray:
    return scan.xyz[scan.xyz[:, 0] > 4].astype(np.float64)


def test_the_chain_of_each_layout_is_the_development_kit_s(real_data):
    raw = KittiRaw(str(real_data / "kitti_raw")).open().load(4)
    xyz = ahead(raw.scan)
    cams = rows_of(real_data / "kitti_raw" / DATE / "calib_cam_to_cam.txt")
    velo = rows_of(real_data / "kitti_raw" / DATE / "calib_velo_to_cam.txt")
    T = square(np.c_[velo["R"].reshape(3, 3), velo["T"]].ravel())
    expected = devkit_pixels(xyz, cams["P_rect_02"], square(cams["R_rect_00"]), T)
    np.testing.assert_allclose(ours(raw, xyz), expected, atol=2e-3)

    tree = real_data / "kitti_object" / "training"
    (name,) = (path.stem for path in (tree / "velodyne").glob("*.bin"))
    source = KittiObject(str(tree)).open()
    frame = source.load(source.ids.index(name))
    xyz = ahead(frame.scan)
    calib = rows_of(tree / "calib" / f"{name}.txt")
    chain = square(calib["R0_rect"]), square(calib["Tr_velo_to_cam"])
    expected = devkit_pixels(xyz, calib["P2"], *chain)
    np.testing.assert_allclose(ours(frame, xyz), expected, atol=2e-3)


def test_the_chain_of_odometry_with_the_scan_of_another_set(real_data, tmp_path):
    # The grey sequence has no scans; its layout folds R_rect into Tr, so write one that does.
    raw = KittiRaw(str(real_data / "kitti_raw")).open().load(0)
    cams = rows_of(real_data / "kitti_raw" / DATE / "calib_cam_to_cam.txt")
    velo = rows_of(real_data / "kitti_raw" / DATE / "calib_velo_to_cam.txt")
    T = square(np.c_[velo["R"].reshape(3, 3), velo["T"]].ravel())
    Tr = square(cams["R_rect_00"]) @ T
    folder = tmp_path / "sequences" / "77"
    drive = real_data / "kitti_raw" / DATE / DRIVE
    for name, of in (
        ("image_2", "image_02/data/0000000000.png"),
        ("image_3", "image_03/data/0000000000.png"),
        ("velodyne", "velodyne_points/data/0000000000.bin"),
    ):
        (folder / name).mkdir(parents=True)
        (folder / name / f"000000{Path(of).suffix}").symlink_to(drive / of)
    lines = [f"P{n}: {' '.join(map(repr, map(float, cams[f'P_rect_0{n}'])))}" for n in range(4)]
    lines.append(f"Tr: {' '.join(map(repr, map(float, Tr[:3].ravel())))}")
    (folder / "calib.txt").write_text("\n".join(lines) + "\n")
    frame = KittiOdometry(str(tmp_path)).open().load(0)
    xyz = ahead(raw.scan)
    expected = devkit_pixels(xyz, cams["P_rect_02"], Tr)
    np.testing.assert_allclose(ours(frame, ahead(frame.scan)), expected, atol=2e-3)


def against_truth(frame, scan, **options) -> np.ndarray:
    """Relative disparity differences of the scan's visible points from the ground truth."""
    seen = project_scan(scan, frame.rig, **options)
    column, row = np.rint(seen.uv).astype(int).T
    truth = frame.truth.values[row, column].astype(float)
    found = disparity_from_depth(seen.depth_m, column.astype(float), frame.rig)
    return (found / truth - 1)[np.isfinite(truth)]


def test_see_through_points_are_removed_and_beams_are_not_to_be_raised(real_data):
    source = KittiStereo(str(real_data / "kitti_stereo2015")).open()
    frames = [source.load(index) for index in range(0, 22, 3)]

    def errors(change=lambda scan: scan, **options):
        return np.concatenate([against_truth(f, change(f.scan), **options) for f in frames])

    kept, every = errors(), errors(occluders=Occluders(0, 0, 0))
    # through (disparity too small by 10 %): 2.7 % of the points before, 1 % after
    assert (kept < -0.1).mean() < 0.5 * (every < -0.1).mean() < 0.02
    assert len(kept) > 0.93 * len(every)
    for angle_rad in np.deg2rad((-0.205, 0.205)):
        tilted = errors(partial(tilted_scan, angle_rad=angle_rad))
        assert np.median(np.abs(tilted)) > 10 * np.median(np.abs(kept))


def tilted_scan(scan: LidarScan, *, angle_rad: float) -> LidarScan:
    return LidarScan(raised(scan.xyz, angle_rad))


def compared(capsys, *args: object, verb="compare") -> dict:
    capsys.readouterr()
    assert main([*verb.split(), *map(str, args), "--no-check", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_compensated_motion_brings_scans_closer_to_stereo(real_data, capsys):
    drive = real_data / "kitti_raw" / DATE
    some = ("--frames", "0::4")
    stored = compared(capsys, drive, *some, "--scans.deskew", "none")
    moved = compared(capsys, drive, *some)
    for each, before in zip(moved["bins"], stored["bins"], strict=True):
        # beyond 50 m it moves nothing that the stock rig would show
        assert each["median_rel"] < 1.01 * before["median_rel"]
    # beside the car, where it moves most between the points: 0.57 m becomes 0.17 m
    assert moved["bins"][0]["rmse_m"] < 0.5 * stored["bins"][0]["rmse_m"]
    raised_beams = compared(capsys, drive, *some, "--scans.tilt-deg", "0.205")
    assert raised_beams["bins"][1]["median_rel"] > 1.8 * moved["bins"][1]["median_rel"]


def test_clouds_of_stereo_against_the_velodyne(real_data, capsys):
    found = compared(capsys, real_data / "kitti_raw" / DATE, verb="evaluate cloud")
    assert sum(note.startswith("scans: moved by the IMU's motion") for note in found["notes"]) == 1
    near, middle = found["bins"][:2]
    assert (found["frames"], found["reference"]) == (10, "LiDAR scans")
    assert near["f_score_0_2"] > 0.95
    assert middle["f_score_0_5"] > 0.97
    assert near["completeness_m"] < 0.05
    assert near["accuracy_median_m"] < middle["accuracy_median_m"] < 0.2
