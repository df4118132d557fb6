"""Files of poses: KITTI's `poses/NN.txt`, 12 numbers a line, a row-major 3x4 matrix."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import PoseFileError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import read_lines
from pseudolidar.geometry.frames import BASE_LINK, MAP
from pseudolidar.structures.arrays import Float64, check_array
from pseudolidar.structures.pose import ROTATION_TOLERANCE, Pose, rotation_error


def read_kitti_poses(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> Float64:
    """Read a KITTI pose file.

    Returns:
        (N, 4, 4) `T_cam0(0)_cam0(i)`, metres, in the axes of rectified camera 0; see
        `body_poses`.

    Raises:
        PoseFileError: missing file, no number, wrong count, or the first row that is not rigid.
    """
    lines = [line for line in read_lines(path, error=PoseFileError, limits=limits) if line.text]
    poses = np.tile(np.eye(4), (len(lines), 1, 1))
    for row, line in enumerate(lines):
        poses[row, :3] = np.reshape(line.numbers(line.words(), count=12), (3, 4))
        error = rotation_error(poses[row, :3, :3])
        if not error <= ROTATION_TOLERANCE:
            raise line.refusal(
                f"pose {row} of {len(lines)} is not rigid: off by {error:.2g}",
                want=f"a rotation to {ROTATION_TOLERANCE:g}",
            )
    return poses


def write_kitti_poses(path: Path, T_cam0_cam0: Float64) -> None:
    """Write (N, 4, 4) `T_cam0(0)_cam0(i)` as a KITTI pose file with all digits."""
    check_array("write_kitti_poses", "T_cam0_cam0", T_cam0_cam0, (None, 4, 4), np.float64)
    rows = (" ".join(repr(float(x)) for x in pose[:3].ravel()) for pose in T_cam0_cam0)
    write_atomic(path, "".join(f"{row}\n" for row in rows).encode())


def body_poses(T_cam0_cam0: Float64, T_base_link_cam0: Pose) -> tuple[Pose, ...]:
    """`T_map_base_link` of camera poses; `map` is `base_link` where the camera's path starts.

    Args:
        T_cam0_cam0: (N, 4, 4) `T_cam0(0)_cam0(i)`.
        T_base_link_cam0: where the camera is on the body.
    """
    B = T_base_link_cam0.matrix
    B_inverse = T_base_link_cam0.inverse().matrix
    return tuple(Pose(MAP, BASE_LINK, B @ T @ B_inverse) for T in T_cam0_cam0)


def camera_poses(T_map_base_link: tuple[Pose, ...], T_base_link_cam0: Pose) -> Float64:
    """(N, 4, 4) `T_cam0(0)_cam0(i)` of body poses: what `body_poses` was made from."""
    B, B_inverse = T_base_link_cam0.matrix, T_base_link_cam0.inverse().matrix
    return np.stack([B_inverse @ pose.matrix @ B for pose in T_map_base_link])
