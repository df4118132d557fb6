"""Files of a path: TUM and KITTI, with all digits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pseudolidar.formats.trajectory import write_kitti_poses
from pseudolidar.formats.tum import tum_time, write_tum_trajectory
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import inverted
from pseudolidar.running.mapped.walked import Piece
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig

TUM_NAME, KITTI_NAME = "trajectory.tum", "trajectory_kitti.txt"


def body_poses_of(piece: Piece, rig: StereoRig) -> Float64:
    """(N, 4, 4) `T_map_base_link`: `map` is `base_link` of the piece's first frame."""
    T_base_left = left_in_base_link(rig).matrix
    return np.asarray(T_base_left @ piece.T_odom_camera @ inverted(T_base_left))


def write_trajectories(folder: Path, pieces: Sequence[Piece], rig: StereoRig) -> tuple[Path, ...]:
    """Write each piece of path: `base_link` as TUM has it, the left camera as KITTI has it.

    Args:
        folder: output folder.
        pieces: the longest first; the others' files have their number in the name.
        rig: places the camera on the body.

    Returns:
        The files.

    Raises:
        OutputError: the disk is full or gone.
    """
    files = []
    for number, piece in enumerate(pieces):
        tum, kitti = (folder / numbered(name, number) for name in (TUM_NAME, KITTI_NAME))
        times_ns = [one.timestamp_ns for one in piece.frames]
        write_tum_trajectory(tum, times_ns, body_poses_of(piece, rig), comments=_marks(piece))
        write_kitti_poses(kitti, piece.T_odom_camera)
        files += [tum, kitti]
    return tuple(files)


def _marks(piece: Piece) -> list[str]:
    """Which poses nothing was measured of, in words; nothing where all were."""
    times = [tum_time(one.timestamp_ns) for one in piece.frames if not one.measured]
    if not times:
        return []
    count = f"{len(times)} of {len(piece.frames)} poses are extrapolated, between measured ones: "
    return [count + " ".join(times)]


def numbered(name: str, number: int) -> str:
    """Name of a file of a piece of path: plain for the first, `NAME_2` for the second."""
    if number == 0:
        return name
    stem, _, ending = name.rpartition(".")
    return f"{stem}_{number + 1}.{ending}"
