"""Which topics of a recording are the two eyes of a pair, and their rig."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.errors import (
    CalibrationMissing,
    NotRectified,
    PseudolidarError,
    UsageError,
)
from pseudolidar.formats.recordings.messages import CameraInfo
from pseudolidar.formats.rigs.rig_reading import Pictures
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.frames import BASE_LINK
from pseudolidar.sources.recording.eyes import SAME_DIRECTION, SAME_PX, Eye
from pseudolidar.sources.recording.raw_eyes import offset_m, raw_rig_of
from pseudolidar.sources.recording.topics import Topics
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import LEFT_FRAME, RIGHT_FRAME, Camera, StereoRig
from pseudolidar.structures.pose import Pose

LEFT, RIGHT, VELODYNE = LEFT_FRAME, RIGHT_FRAME, "velodyne"
_LEFT_NAME = re.compile(r"(?<![a-z])left(?![a-z])|(?<![a-z])l(?![a-z])", re.IGNORECASE)
_RIGHT_NAME = re.compile(r"(?<![a-z])right(?![a-z])|(?<![a-z])r(?![a-z])", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class StereoTopics:
    """The two eyes and their rig.

    Args:
        left: left pictures.
        right: right pictures.
        rig: of the pictures.
        line: how they were found.
    """

    left: Eye
    right: Eye
    rig: StereoRig
    line: str


def find_pair(
    topics: Topics,
    eyes: Sequence[Eye],
    tree: Sequence[Pose],
    names: tuple[str, str] | None,
    pictures: Pictures,
) -> StereoTopics | None:
    """The pair of a recording, None where it has none.

    Args:
        topics: the recording.
        eyes: its topics of pictures.
        tree: its transforms at its beginning.
        names: topics of left and right, where the user names them.
        pictures: which are wanted; rectified ones count first.

    Raises:
        UsageError: a named topic is not there.
        CalibrationMissing: the named topics have no calibration.
        NotRectified: rectified pairs are wanted, and the only ones are raw; or nobody can tell how
            to rectify these.
    """
    if names is not None:
        left, right = (_named(eyes, name) for name in names)
        for eye in (left, right):
            if eye.camera is None:
                raise _uncalibrated(topics, eye)
        raw = pictures == "raw" or not (left.is_rectified and right.is_rectified)
        if raw and pictures != "rectified":
            taken = raw_pair(left, right, tree, "raw pictures named by --topics")
            if taken is not None or pictures == "raw":
                return taken
        return _pair(left, right, tree, "named by --topics", forced=True)
    found = [pair for a in eyes for b in eyes if (pair := _candidate(a, b, tree))]
    good = [pair for pair in found if pair.left.is_rectified and pair.right.is_rectified]
    if good and pictures != "raw":
        return max(good, key=_preference)
    raw_pairs = [pair for a in eyes for b in eyes if (pair := _raw_candidate(a, b, tree))]
    if raw_pairs and pictures != "rectified":
        return max(raw_pairs, key=_preference)
    if found and not good:
        raise _unrectified(found[0])
    return None


def given_eyes(eyes: Sequence[Eye], names: tuple[str, str] | None) -> tuple[Eye, Eye] | None:
    """Left and right where the user gives the rig: named, or told apart by their names."""
    if names is not None:
        return _named(eyes, names[0]), _named(eyes, names[1])
    for left in eyes:
        for right in eyes:
            both = _right_by_names(left, right)
            if both and _without_side(left.name) == _without_side(right.name):
                return left, right
    return None


def _named(eyes: Sequence[Eye], name: str) -> Eye:
    for eye in eyes:
        if name in (eye.topic.name, eye.name):
            return eye
    raise UsageError(
        f"no topic of pictures {name!r}",
        want=f"one of {', '.join(eye.topic.name for eye in eyes) or 'none: there are no pictures'}",
        where="topics",
    )


def _candidate(a: Eye, b: Eye, tree: Sequence[Pose]) -> StereoTopics | None:
    """The pair of `a` as left and `b` as right eye, if they can be one."""
    if a is b or a.camera is None or b.camera is None or a.topic.name == b.topic.name:
        return None
    P, P_right = a.camera.P, b.camera.P
    size, size_right = (
        (eye.camera.width_px, eye.camera.height_px) for eye in (a, b) if eye.camera is not None
    )
    same_image = size == size_right and _image_name(a) == _image_name(b)
    if not same_image or np.abs(P[:, [0, 1]] - P_right[:, [0, 1]]).max() > SAME_PX:
        return None
    if abs(P[1, 2] - P_right[1, 2]) > SAME_PX:
        return None
    if b.shift_m < a.shift_m:
        return _pair(a, b, tree, "by their calibration")
    if a.shift_m == b.shift_m == 0 and _right_by_names(a, b) and a.frame != b.frame:
        return _pair(a, b, tree, "by their names, apart by tf")
    return None


def _raw_candidate(a: Eye, b: Eye, tree: Sequence[Pose]) -> StereoTopics | None:
    """The pair of `a` as left and `b` as right eye, if both are unrectified and can be one."""
    if a is b or a.camera is None or b.camera is None or a.topic.name == b.topic.name:
        return None
    if a.is_rectified or b.is_rectified or _image_name(a) != _image_name(b):
        return None
    stereo = b.shift_m < a.shift_m
    alone = a.shift_m == b.shift_m == 0 and _right_by_names(a, b) and a.frame != b.frame
    line = "by their calibration" if stereo else "by their names, apart by tf"
    return raw_pair(a, b, tree, f"raw pictures, {line}") if stereo or alone else None


def _pair(
    left: Eye, right: Eye, tree: Sequence[Pose], line: str, *, forced: bool = False
) -> StereoTopics | None:
    try:
        return StereoTopics(left, right, _rig(left, right, tree), line)
    except PseudolidarError:
        if forced:
            raise
        return None


def raw_pair(left: Eye, right: Eye, tree: Sequence[Pose], line: str) -> StereoTopics | None:
    """Two topics of unrectified pictures as a pair, None where their calibration is not enough."""
    try:
        rig = raw_rig_of(left, right, tree)
    except PseudolidarError:
        return None
    return None if rig is None else StereoTopics(left, right, rig, line)


def _rig(left: Eye, right: Eye, tree: Sequence[Pose]) -> StereoRig:
    """The rig of the rectified images: `P` of both cameras.

    Raises:
        CalibrationValue, NotRectified: they are none.
    """
    assert left.camera is not None
    assert right.camera is not None
    K, K_right = left.camera.P[:, :3], right.camera.P[:, :3]
    t_m = offset_m(right.camera.P) - offset_m(left.camera.P)
    if not t_m.any():
        T_right_left = chain(tree, right.frame, left.frame)
        if T_right_left is not None and _parallel(T_right_left):
            t_m = T_right_left.translation_m
    rig = StereoRig(
        _camera(left.camera, K, LEFT),
        _camera(right.camera, K_right, RIGHT),
        Pose.from_rotation(RIGHT, LEFT, np.eye(3), t_m),
        origin="calibration in the recording",
    )
    if not rig.is_rectified:
        raise NotRectified(
            f"projections of {left.topic.name} and {right.topic.name} that are no rectified pair",
            want="equal focal lengths and rows, a baseline along the rows",
            fix="Rectify the pictures, or give their rig: --rig rig.json.",
        )
    return rig


def _camera(info: CameraInfo, K: Float64, frame: str) -> Camera:
    return Camera(np.ascontiguousarray(K), info.width_px, info.height_px, frame=frame)


def _parallel(pose: Pose) -> bool:
    return bool(np.abs(pose.matrix[:3, :3] - np.eye(3)).max() < SAME_DIRECTION)


def _image_name(eye: Eye) -> str:
    """Last part of its topic: an `image_rect` and an `image_raw` are no pair."""
    return _without_side(eye.name.rpartition("/")[2])


def _without_side(name: str) -> str:
    return _RIGHT_NAME.sub("", _LEFT_NAME.sub("", name))


def _right_by_names(a: Eye, b: Eye) -> bool:
    return bool(_LEFT_NAME.search(a.name) and _RIGHT_NAME.search(b.name))


def _preference(pair: StereoTopics) -> tuple[bool, bool, bool, int, str]:
    """Pairs that are named so first, then colour, then plain transport, then the longer one."""
    name = pair.left.name
    colour = "mono" not in name and "gray" not in name and "grey" not in name
    plain = pair.left.topic.name == name and pair.right.topic.name == pair.right.name
    return (
        _right_by_names(pair.left, pair.right),
        colour,
        plain,
        min(len(pair.left.topic), len(pair.right.topic)),
        name,
    )


def _uncalibrated(topics: Topics, eye: Eye) -> CalibrationMissing:
    cameras = ", ".join(topic.name for topic in topics.of_kind("camera"))
    return CalibrationMissing(
        f"no calibration for {eye.topic.name}",
        want=f"a camera_info beside it; there are {cameras or 'none'}",
        fix="Give the rig of the pair: --rig rig.json.",
    )


def _unrectified(pair: StereoTopics) -> NotRectified:
    eye = pair.left if not pair.left.is_rectified else pair.right
    assert eye.camera is not None
    D = ", ".join(f"{value:g}" for value in eye.camera.D[:5])
    return NotRectified(
        f"{pair.left.topic.name} and {pair.right.topic.name} are raw pictures "
        f"(distortion {eye.camera.model} {D}; rectified ones are called image_rect)",
        want="rectified pictures, or a lens model that is known: plumb_bob, rational_polynomial, "
        "equidistant",
        fix="Record image_rect, e.g. of ROS's image_proc, or give a rig: --rig rig.json.",
    )


def with_lidar(rig: StereoRig, tree: Sequence[Pose], left: str, lidar: str | None) -> StereoRig:
    """The rig with a LiDAR on it, as `velodyne`, unless it has one already.

    The body of the recording stands for the IMU.

    Args:
        rig: the cameras.
        tree: transforms of the recording.
        left: optical frame of the left camera there.
        lidar: frame of the LiDAR there, None without one.
    """
    T_left_lidar = None if lidar is None else chain(tree, left, lidar)
    if lidar is None or T_left_lidar is None or rig.T_left_velodyne is not None:
        return rig
    T_lidar_body = chain(tree, lidar, BASE_LINK)
    return replace(
        rig,
        T_left_velodyne=Pose(LEFT, VELODYNE, T_left_lidar.matrix),
        T_velodyne_imu=T_lidar_body and Pose(VELODYNE, "imu", T_lidar_body.matrix),
    )
