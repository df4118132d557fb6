"""The rig of two eyes whose pictures a recording has as they were taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.formats.recordings.messages import CameraInfo
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.sources.recording.eyes import Eye
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import (
    LEFT_FRAME,
    RIGHT_FRAME,
    Camera,
    LensModel,
    StereoRig,
)
from pseudolidar.structures.pose import Pose

# Lens models of ROS and of Foxglove, which took over its words; with the numbers that they have.
MODELS: dict[str, tuple[LensModel, tuple[int, ...]]] = {
    "": ("pinhole", (0,)),
    "plumb_bob": ("pinhole", (0, 4, 5)),
    "rational_polynomial": ("pinhole", (8, 12, 14)),
    "equidistant": ("fisheye", (4,)),
    "fisheye": ("fisheye", (4,)),
    "kannala_brandt": ("fisheye", (4,)),
    "kannala_brandt4": ("fisheye", (4,)),
}


def raw_rig_of(left: Eye, right: Eye, tree: Sequence[Pose]) -> StereoRig | None:
    """The rig of the pictures as they were taken; None where their calibration does not tell it.

    How the cameras stand to each other follows from the rotations and projections by which they
    are to be rectified, which both have for that purpose; else from tf.

    Args:
        left: topic of the left eye.
        right: of the right one.
        tree: transforms of the recording.

    Raises:
        CalibrationValue: no camera, or no rig, can be so.
    """
    left_camera, right_camera = _camera(left.camera, LEFT_FRAME), _camera(right.camera, RIGHT_FRAME)
    T_right_left = _by_rectification(left.camera, right.camera)
    if T_right_left is None:
        T = chain(tree, right.frame, left.frame)
        T_right_left = None if T is None else Pose(RIGHT_FRAME, LEFT_FRAME, T.matrix)
    if left_camera is None or right_camera is None or T_right_left is None:
        return None
    return StereoRig(left_camera, right_camera, T_right_left, origin="calibration in the recording")


def _camera(info: CameraInfo | None, frame: str) -> Camera | None:
    if info is None or info.model not in MODELS or not info.K[0, 0] > 0:
        return None
    model, lengths = MODELS[info.model]
    used = info.D[: np.flatnonzero(info.D)[-1] + 1] if info.D.any() else info.D[:0]
    length = next((n for n in lengths if n >= len(used)), None)
    if length is None:
        return None
    D = np.zeros(length)
    D[: len(used)] = used
    return Camera(np.ascontiguousarray(info.K), info.width_px, info.height_px, D, model, frame)


def _by_rectification(left: CameraInfo | None, right: CameraInfo | None) -> Pose | None:
    """`T_right_left`: turned into the rectified frame, moved along its rows, and turned back."""
    if left is None or right is None:
        return None
    shift_m = offset_m(right.P) - offset_m(left.P)
    if not shift_m.any() or not (left.R.any() and right.R.any()):
        return None
    R_right_left = right.R.T @ left.R
    return Pose.from_rotation(RIGHT_FRAME, LEFT_FRAME, R_right_left, right.R.T @ shift_m)


def offset_m(P: Float64) -> Float64:
    """(3,) `t` of `P = K [I | t]`: minus where the camera is in the frame that `P` projects."""
    z = P[2, 3]
    return np.array([(P[0, 3] - P[0, 2] * z) / P[0, 0], (P[1, 3] - P[1, 2] * z) / P[1, 1], z])
