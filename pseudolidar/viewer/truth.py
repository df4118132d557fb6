"""Where the rig of a run really was, beside where the run says that it was."""

from __future__ import annotations

import numpy as np

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.trajectory_file import PoseRecord
from pseudolidar.geometry.twists import inverted
from pseudolidar.sources.known_poses import pose_of
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.recorded import HeldFrame

# Times of the same frame differ by no more: files of paths have them in microseconds.
SAME_NS = NS_PER_S // 1000


def true_places(source: FrameSequence[HeldFrame], estimated: PoseRecord) -> Float64 | None:
    """(N, 3) where the frames of a source were, as seen from where the estimated path begins.

    Both are one at the first frame that both have; what is beside it later is the error.

    Args:
        source: that the path was estimated of.
        estimated: `T_map_base_link` with times.

    Returns:
        None where the source does not tell its poses, or has no frame of that path.
    """
    pose_at = pose_of(source)
    if pose_at is None or estimated.times_ns is None:
        return None
    found = {index: pose_at(index) for index in range(len(source.ids))}
    poses = {index: pose.matrix for index, pose in found.items() if pose is not None}
    times_ns = np.array([source.timestamps_ns[index] for index in poses], np.int64)
    common = _first_common(times_ns, estimated.times_ns)
    if common is None:
        return None
    every = np.array([*poses.values()])
    T_estimated_true = estimated.T_world_body[common[1]] @ inverted(every[common[0]])
    return np.ascontiguousarray((T_estimated_true @ every)[:, :3, 3])


def _first_common(true_ns: Int64, estimated_ns: Int64) -> tuple[int, int] | None:
    """Positions of the first two times that are the same; None where none are."""
    if not len(true_ns):
        return None
    for position, time_ns in enumerate(estimated_ns):
        nearest = int(np.abs(true_ns - time_ns).argmin())
        if abs(int(true_ns[nearest]) - int(time_ns)) <= SAME_NS:
            return nearest, position
    return None
