"""What every cloud tool is, where it looks from, and the row of tools that a cloud passes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self

import numpy as np

from pseudolidar.geometry.cloud_frames import is_optical
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.frames import BASE_LINK, R_BODY_OPTICAL
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

CAMERA, LIDAR = "camera_left", "velodyne"


class Tooled(NamedTuple):
    """A cloud, and what a tool did.

    Args:
        cloud: the cloud.
        figures: counts and measures by name, for the report.
    """

    cloud: PointCloud
    figures: Mapping[str, float]


class CloudTool(Protocol):
    """Pure, picklable, safe to call from several threads at once; keeps all columns."""

    def __call__(self, cloud: PointCloud, tree: tuple[Pose, ...], /) -> Tooled:
        """The cloud in its frame, with what its source knows about frames (`T_parent_child`)."""


class CloudToolSettings(Protocol):
    """Settings of a tool."""

    def load(self) -> CloudTool:
        """The tool, with everything heavy loaded."""


@dataclass(frozen=True)
class CloudTools:
    """Tools in a row.

    Args:
        tools: the first sees the cloud as it was made.
    """

    tools: tuple[CloudTool, ...] = ()

    @classmethod
    def load(cls, *chosen: CloudToolSettings | None) -> Self:
        """Those that are chosen, in this order."""
        return cls(tuple(settings.load() for settings in chosen if settings is not None))

    def __call__(self, cloud: PointCloud, tree: Iterable[Pose]) -> Tooled:
        """Pass the cloud through all of them; figures of all together."""
        figures: dict[str, float] = {}
        tree = tuple(tree) if self.tools else ()
        for tool in self.tools:
            tooled = tool(cloud, tree)
            cloud = tooled.cloud
            figures |= tooled.figures
        return Tooled(cloud, figures)


def kept(cloud: PointCloud, keep: Bool) -> PointCloud:
    """The points of `keep` (N,); an organised cloud keeps its shape, others become NaN."""
    if cloud.shape is None:
        return cloud[keep]
    return replace(cloud, xyz=np.where(keep[:, None], cloud.xyz, cloud.xyz.dtype.type(np.nan)))


def count(cloud: PointCloud) -> int:
    """Points that are there."""
    return len(cloud) if cloud.shape is None else int(np.count_nonzero(cloud.valid))


def forward_of(cloud: PointCloud, tree: tuple[Pose, ...]) -> Pose:
    """`T_forward_cloud`: to a frame with x forward, y left, z up; `velodyne` where it is known.

    A cloud whose frame is unknown to the tree is turned where its frame's name is a camera's, and
    taken as it is otherwise.
    """
    for name in (LIDAR, BASE_LINK):
        T_name_cloud = chain(tree, name, cloud.frame)
        if T_name_cloud is not None:
            return T_name_cloud
    if is_optical(cloud.frame):
        return Pose.from_rotation(BASE_LINK, cloud.frame, R_BODY_OPTICAL, np.zeros(3))
    return Pose.identity(cloud.frame, cloud.frame)


def camera_of(cloud: PointCloud, tree: tuple[Pose, ...]) -> Pose | None:
    """`T_cloud_camera`: the left camera that a cloud with pixels was seen by, where it is known."""
    if cloud.uv is None:
        return None
    return chain(tree, cloud.frame, CAMERA)


def origin_of(cloud: PointCloud, tree: tuple[Pose, ...]) -> Float64:
    """(3,) where the cloud was seen from, in its frame: its camera, else the frame's origin."""
    camera = camera_of(cloud, tree)
    return np.zeros(3) if camera is None else camera.translation_m
