"""Drives as KITTI's unsynchronised raw data have them, of a rendered room seen through lenses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.velodyne_txt import encode_velodyne_txt
from pseudolidar.formats.rigs.key_values import key_values_text
from pseudolidar.formats.timestamps import write_timestamps
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.pose import Pose

DATE, DRIVE = "2026_01_02", "2026_01_02_drive_0007_extract"
START_NS, STEP_NS = 1_700_000_000_123_456_789, 100_000_003
VELO_TO_CAM = Pose.from_rotation(
    "camera_0",
    "velodyne",
    np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
    np.array([0.0, -0.1, -0.3]),
)


def stamps(count: int, *, late_ns: int = 0) -> list[int]:
    return [START_NS + n * STEP_NS + late_ns for n in range(count)]


def write_calibration(folder: Path, rig: StereoRig, *, cameras: tuple[int, int] = (0, 1)) -> None:
    """The cameras of a rig as numbers `cameras`; camera 0 is the left one, or stands beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    T_left_cam0 = np.eye(4)
    if cameras != (0, 1):
        T_left_cam0[:3, 3] = 0.06, 0.001, 0.002
    poses = (T_left_cam0, rig.T_right_left.matrix @ T_left_cam0)
    fields = {"calib_time": "09-Jan-2026 13:57:47", "corner_dist": np.array([0.1])}
    for number, camera, pose in zip(cameras, (rig.left, rig.right), poses, strict=True):
        distortion = np.zeros(5)
        distortion[: len(camera.distortion)] = camera.distortion
        fields |= {
            f"S_0{number}": np.array(camera.size_px, float),
            f"K_0{number}": camera.K,
            f"D_0{number}": distortion,
            f"R_0{number}": pose[:3, :3],
            f"T_0{number}": pose[:3, 3],
        }
    (folder / "calib_cam_to_cam.txt").write_text(key_values_text(fields))
    mounted = {"R": VELO_TO_CAM.matrix[:3, :3], "T": VELO_TO_CAM.translation_m}
    (folder / "calib_velo_to_cam.txt").write_text(key_values_text(mounted))


def write_pictures(
    drive: Path, camera: int, pictures: Sequence[np.ndarray], times_ns: Sequence[int] | None
) -> None:
    data = drive / f"image_0{camera}" / "data"
    data.mkdir(parents=True, exist_ok=True)
    for number, picture in enumerate(pictures):
        (data / f"{number:010d}.png").write_bytes(encode_png(picture))
    if times_ns is not None:
        write_timestamps(data.parent / "timestamps.txt", times_ns)


def write_scans(
    drive: Path, scans: Sequence[LidarScan], times_ns: Sequence[int] | None = None
) -> None:
    data = drive / "velodyne_points" / "data"
    data.mkdir(parents=True, exist_ok=True)
    for number, scan in enumerate(scans):
        (data / f"{number:010d}.txt").write_bytes(encode_velodyne_txt(scan))
    if times_ns is not None:
        write_timestamps(data.parent / "timestamps.txt", times_ns)


def some_scan(first: float = 1.0) -> LidarScan:
    xyz = np.arange(30, dtype=np.float32).reshape(10, 3) + np.float32(first)
    return LidarScan(xyz, np.linspace(0, 1, 10, dtype=np.float32))
