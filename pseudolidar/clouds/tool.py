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
# Where a ready-made cloud was seen from, as a frame of its own in the tree: once a cloud stands in
# `map`, the frame that it came in is not known otherwise.
SEEN_FROM = "seen_from"


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

    Where the tree knows neither that nor `base_link` it is the frame that the cloud was seen from,
    turned if its name is a camera's.
    """
    for name in (LIDAR, BASE_LINK):
        T_name_cloud = chain(tree, name, cloud.frame)
        if T_name_cloud is not None:
            return T_name_cloud
    own = next((pose.dst for pose in tree if pose.src == SEEN_FROM), cloud.frame)
    T_own_cloud = chain(tree, own, cloud.frame) or Pose.identity(cloud.frame, cloud.frame)
    if not is_optical(T_own_cloud.dst):
        return T_own_cloud
    T_forward_own = Pose.from_rotation(BASE_LINK, T_own_cloud.dst, R_BODY_OPTICAL, np.zeros(3))
    return T_forward_own @ T_own_cloud


def camera_of(cloud: PointCloud, tree: tuple[Pose, ...]) -> Pose | None:
    """`T_cloud_camera`: the left camera that a cloud with pixels was seen by, where it is known."""
    if cloud.uv is None:
        return None
    return chain(tree, cloud.frame, CAMERA)


def origin_of(cloud: PointCloud, tree: tuple[Pose, ...]) -> Float64:
    """(3,) where the cloud was seen from, in its frame.

    That is its camera, else the sensor that the tree names, else the origin of its frame.
    """
    seen_from = camera_of(cloud, tree) or chain(tree, cloud.frame, SEEN_FROM)
    return np.zeros(3) if seen_from is None else seen_from.translation_m


def seen_in(frame: str, tree: Iterable[Pose]) -> tuple[Pose, ...]:
    """The tree that says as well that a cloud was seen from the origin of `frame`."""
    return (*tree, Pose.identity(frame, SEEN_FROM))
