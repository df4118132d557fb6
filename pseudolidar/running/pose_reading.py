"""Poses to be judged, or to judge by: of a file, or of a source that knows where it was."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from pseudolidar.errors import PoseMissing
from pseudolidar.formats.trajectory_file import KITTI_VERTICAL, PoseRecord, read_trajectory
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.frames import BASE_LINK, MAP, left_in_base_link
from pseudolidar.running.progress import FrameProgress
from pseudolidar.sources.known_poses import pose_of
from pseudolidar.sources.recognise import Source, recognise
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import HeldFrame, RecordedCloud

# Whose poses a source tells: the body's, or the left camera's, as KITTI's pose files have them.
PosedBody = Literal["base_link", "camera_left"]

BODY_VERTICAL = 2  # of `map`: x forward, y left, z up


def read_poses(path: Path, *, body: PosedBody, times: Path | None) -> PoseRecord:
    """Poses of a file, or of the frames of a source.

    Args:
        path: file of poses, or what `convert` takes as a source.
        body: whose poses a source tells; a file has those that it has.
        times: of a file's poses, where they stand in another.

    Raises:
        SourceUnknown: neither.
        PoseMissing: a source that knows no pose.
        PoseFileError, SequenceTime, LimitError: as `read_trajectory`.
    """
    if path.is_file():
        return read_trajectory(path, times=times)
    return source_poses(recognise(str(path)), path, body=body)


def source_poses(settings: Source, path: Path, *, body: PosedBody) -> PoseRecord:
    """Poses of the frames of a source; `T_world_body` begins where its own do.

    Raises:
        PoseMissing: it knows none.
    """
    source = settings.open()
    times_ns, T_map_base = _known_poses(source)
    if not len(times_ns):
        raise PoseMissing(
            f"{source.summary.line}: no frame knows where it was",
            want="a file of poses (TUM, KITTI, EuRoC), or a source with poses",
            path=path,
        )
    missing = len(source.ids) - len(times_ns)
    notes = (f"{missing} frames of {path.name} without a pose left out",) if missing else ()
    if body == "camera_left" and source.rig is not None:
        T_base_left = left_in_base_link(source.rig)
        T_map_base = T_base_left.inverse().matrix @ T_map_base @ T_base_left.matrix
    told = f"{path.name}: poses of {body} in {source.summary.line}"
    vertical = KITTI_VERTICAL if body == "camera_left" else BODY_VERTICAL
    return PoseRecord(path, "frames", T_map_base, times_ns, notes=(told, *notes), vertical=vertical)


def _known_poses(source: FrameSequence[HeldFrame]) -> tuple[Int64, Float64]:
    """Times and `T_map_base_link` of the frames that have a pose; loaded where that is needed."""
    pose_at = pose_of(source) or (lambda index: _pose(source.load(index)))
    poses, times_ns = [], []
    with FrameProgress(len(source.ids)) as progress:
        for index, stamp_ns in enumerate(source.timestamps_ns):
            pose = pose_at(index)
            progress.advance()
            if pose is not None:
                poses.append(pose.matrix)
                times_ns.append(stamp_ns)
    return np.array(times_ns, np.int64), np.array(poses).reshape(-1, 4, 4)


def _pose(frame: HeldFrame) -> Pose | None:
    """`T_map_base_link` of a frame; a recorded cloud's tree may tell it."""
    if isinstance(frame, RecordedCloud):
        return chain(frame.tree, MAP, BASE_LINK)
    return frame.pose
