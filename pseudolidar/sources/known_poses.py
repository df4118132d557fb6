"""Where the body was at the frames of a source, told without reading their pictures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.kitti.frames import KittiFrames
from pseudolidar.sources.other_rig import RiggedSource
from pseudolidar.sources.selection import SelectedSource
from pseudolidar.sources.source import FrameSequence
from pseudolidar.sources.synthetic import SyntheticSource
from pseudolidar.sources.tum_depth import DepthPictures
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import HeldFrame

# `T_map_base_link` of a frame by its index, None where it is not known; may raise PoseFileError.
PoseOf = Callable[[int], Pose | None]


def pose_of(source: FrameSequence[HeldFrame]) -> PoseOf | None:
    """Tells `T_map_base_link` of frames as they have it once loaded.

    Args:
        source: opened.

    Returns:
        None where frames must be loaded to know.
    """
    match source:
        case SyntheticSource() | KittiFrames():
            return source.pose
        case DepthPictures():
            return source.poses.__getitem__
        case SelectedSource():
            whole = pose_of(source.source)
            return None if whole is None else lambda index: whole(source.chosen[index])
        case RiggedSource() if not _same_body(source):
            return None
        case ChangedSource() | RiggedSource():
            return pose_of(source.source)
    return None


def _same_body(source: RiggedSource) -> bool:
    """Whether another rig is on the same body, so that poses are of the same thing."""
    own, given = source.source.rig, source.rig
    if own is None or not given.metric:
        return False
    return np.array_equal(left_in_base_link(own).matrix, left_in_base_link(given).matrix)
