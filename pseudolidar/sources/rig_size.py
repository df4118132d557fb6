"""A calibration and the pictures that it is used for: the same size, or scaled where asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pseudolidar.errors import CalibrationSizeMismatch
from pseudolidar.structures.camera import StereoRig

# What is said of a source whose frames lose what was measured in metres.
IN_METRES = "scans and poses of the source left aside: lengths of the rig are no metres"


def fitting_rig(
    rig: StereoRig,
    eye_px: tuple[int, int],
    *,
    scale_calibration: bool,
    path: Path | None = None,
) -> StereoRig:
    """The rig for eyes of (width, height) `eye_px`, scaled to them where that is wanted.

    Args:
        rig: of any size.
        eye_px: size of the left picture, px.
        scale_calibration: whether it may be scaled.
        path: the file that an error names.

    Raises:
        CalibrationSizeMismatch: it is for another size.
    """
    if rig.left.size_px == eye_px:
        return rig
    if scale_calibration:
        return rig.scaled_to(*eye_px)
    raise CalibrationSizeMismatch(
        f"a rig for images of {rig.left.width_px}x{rig.left.height_px}",
        want=f"{eye_px[0]}x{eye_px[1]}, the size of the images",
        fix="Pass --scale-calibration if the images were resized, or the right rig.",
        path=path,
    )


def with_sensors_of(own: StereoRig, rig: StereoRig) -> StereoRig:
    """A rig that replaces a source's own, with what the source knows of LiDAR and IMU.

    The LiDAR is raised as `rig` knows. Where the source knows nothing of them, those of `rig`
    count. Where lengths are no metres, nothing that is measured in metres has a place.
    """
    if not rig.metric:
        return replace(rig, T_left_velodyne=None, T_velodyne_imu=None)
    return replace(
        rig,
        T_left_velodyne=rig.lidar_of(own),
        T_velodyne_imu=own.T_velodyne_imu or rig.T_velodyne_imu,
    )
