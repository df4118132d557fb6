"""Drives of KITTI's raw data, rectified or not: where they are, their cameras and calibration."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import CalibrationMissing, PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_size
from pseudolidar.formats.rigs.kitti import CAM_TO_CAM, IMU_TO_VELO, VELO_TO_CAM, read_raw_calib
from pseudolidar.sources.kitti.parts import CameraFolders, camera_folders

CAMERA_FOLDERS = tuple(f"image_0{number}" for number in range(4))
DATE = re.compile(r"[0-9]{4}_[0-9]{2}_[0-9]{2}")
# What the names of unrectified drives end with.
UNRECTIFIED = "extract"


@dataclass(frozen=True)
class CalibrationPaths:
    """The calibration files of a drive.

    Args:
        cameras: `calib_cam_to_cam.txt`.
        velodyne: `calib_velo_to_cam.txt`, None where it is not there.
        imu: `calib_imu_to_velo.txt`, None where it is not there.
        absent: what is not there, in words.
        date: day that it is for, "" where its folder does not say it.
    """

    cameras: Path
    velodyne: Path | None
    imu: Path | None
    absent: tuple[str, ...]
    date: str

    @property
    def paths(self) -> tuple[Path, Path | None, Path | None]:
        """Cameras, Velodyne, IMU."""
        return self.cameras, self.velodyne, self.imu


def drives_in(path: Path) -> list[Path]:
    """Drive folders: `path` itself, below it, or below its date folders."""
    if _is_drive(path):
        return [path]
    children = _folders(path)
    drives = [child for child in children if _is_drive(child)]
    for child in children:
        if DATE.fullmatch(child.name):
            drives += [folder for folder in _folders(child) if _is_drive(folder)]
    return drives


def drive_cameras(drive: Path) -> tuple[CameraFolders, ...]:
    """The camera pairs that a drive can have."""
    grey0, grey1, colour2, colour3 = (f"{name}/data" for name in CAMERA_FOLDERS)
    return camera_folders(drive, colour=[(colour2, colour3)], grey=[(grey0, grey1)])


def calibration_files(drive: Path) -> CalibrationPaths:
    """Calibration beside the drive, as it comes, or in it.

    Raises:
        CalibrationMissing: none of the cameras.
    """
    folder = _calibration_folder(drive)
    if folder is None:
        raise CalibrationMissing(
            f"no {CAM_TO_CAM}",
            want=f"{CAM_TO_CAM}, {VELO_TO_CAM} and {IMU_TO_VELO} beside the drive",
            fix="Get the calibration of that date, a separate download.",
            path=drive.resolve().parent,
        )
    optional = [folder / VELO_TO_CAM, folder / IMU_TO_VELO]
    absent = tuple(f"calibration {path.name}" for path in optional if not path.is_file())
    velodyne, imu = (path if path.is_file() else None for path in optional)
    return CalibrationPaths(folder / CAM_TO_CAM, velodyne, imu, absent, date_of(folder))


def is_unrectified(drive: Path, limits: Limits = DEFAULT_LIMITS) -> bool:
    """Whether a drive is of the unrectified data: by its name, or the size of a picture."""
    if drive.name.endswith(UNRECTIFIED):
        return True
    folder = _calibration_folder(drive)
    shown = next((cameras for cameras in drive_cameras(drive) if cameras.complete), None)
    if folder is None or shown is None:
        return False
    try:
        calibration = read_raw_calib(folder / CAM_TO_CAM, limits=limits)
        camera, paths = shown.numbers[0], shown.left.paths
        raw_px, rectified_px = (
            calibration.raw_sizes_px.get(camera),
            calibration.sizes_px.get(camera),
        )
        if raw_px is None or raw_px == rectified_px:
            return False
        return read_size(paths[min(paths)], limits=limits) == raw_px
    except PseudolidarError:
        return False  # it is refused when it is opened


def date_of(folder: Path) -> str:
    """Date in the name of a drive or of the folder of a day, or nothing."""
    match = DATE.match(folder.resolve().name)
    return match[0] if match else ""


def _calibration_folder(drive: Path) -> Path | None:
    folders = (drive.resolve().parent, drive)
    return next((folder for folder in folders if (folder / CAM_TO_CAM).is_file()), None)


def _is_drive(path: Path) -> bool:
    return any((path / name / "data").is_dir() for name in CAMERA_FOLDERS)


def _folders(path: Path) -> list[Path]:
    try:
        return sorted(child for child in path.iterdir() if child.is_dir())
    except OSError:
        return []
