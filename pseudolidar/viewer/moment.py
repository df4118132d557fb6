"""What there is to see of one frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.cloud_frames import forward_frame, left_in
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.frames import MAP
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.arrays import AnyArray, Float64
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import DepthFrame

if TYPE_CHECKING:
    from pseudolidar.viewer.objects.in_order import Told

# Names of the clouds of a frame: as cameras see it, as its LiDAR does, as it was recorded.
STEREO, VELODYNE, POINTS = "stereo", "velodyne", "points"
# Column of points that know when they were taken, s since the time of their cloud.
TIME = "time_s"
# Coordinates beyond are no place on Earth, m.
FARTHEST_M = 1e9


@dataclass(frozen=True, eq=False)
class Sight:
    """A camera as it stands in the scene.

    Args:
        camera: its pinhole.
        T_forward_camera: (4, 4) maps its points into the frame of the clouds.
    """

    camera: Camera
    T_forward_camera: Float64

    def forward(self, xyz_m: Float64) -> Float64:
        """(3,) where a point (3,) m of the camera is in the frame of the clouds."""
        return np.asarray((self.T_forward_camera @ np.append(xyz_m, 1.0))[:3])


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame, ready to be drawn.

    Args:
        id: the source's name of it.
        index: place in the source.
        timestamp_ns: when it was taken.
        clouds: by name, all in one frame with x forward, y left, z up.
        sight: the left camera, or the only one; None where clouds came alone.
        T_map_forward: (4, 4) where that frame is in the map; None where nobody knows.
        converted: pictures, disparities and depth that the clouds were made of.
        compared: the same by two settings, the first of which were kept; None where nothing is
            compared.
        matched_at: size of the pictures that were matched, as a share of theirs: less than 1 is a
            first look.
        fault: why it cannot be shown; then there is nothing else.
        makings: what clouds were made of whose depths can be judged, by their names.
        told: what the run that made it found in it; None where it looks for nothing.
    """

    id: str
    index: int
    timestamp_ns: int = 0
    clouds: Mapping[str, PointCloud] = field(default_factory=dict)
    sight: Sight | None = None
    T_map_forward: Float64 | None = None
    converted: Converted | None = None
    compared: tuple[Converted, Converted] | None = None
    matched_at: float = 1.0
    fault: str = ""
    makings: Mapping[str, Converted] = field(default_factory=dict)
    told: Told | None = None

    @classmethod
    def of(cls, converted: Converted) -> Self:
        """What a conversion made of a frame."""
        frame, cloud = converted.frame, converted.forward_cloud
        return cls(
            frame.id,
            frame.index,
            frame.timestamp_ns,
            _clouds(converted, cloud),
            _sight(converted, cloud.frame),
            _in_map(converted, cloud.frame),
            converted,
            makings={STEREO: converted} if converted.disparity is not None else {},
        )

    @property
    def nbytes(self) -> int:
        """What it holds, roughly."""
        clouds = [*self.clouds.values(), *(one.cloud for one in self.compared or ())]
        columns = [
            column
            for cloud in clouds
            for column in (cloud.xyz, cloud.rgb, cloud.sigma_m, cloud.uv, *cloud.extra.values())
            if column is not None
        ]
        own = () if self.converted is None else (self.converted,)
        every = (*self.makings.values(), *own, *(self.compared or ()))
        for made in {id(each): each for each in every}.values():
            columns += _arrays(made)
        return sum(column.nbytes for column in columns)


def _arrays(made: Converted) -> list[AnyArray]:
    """Maps and pictures that a conversion holds."""
    columns: list[AnyArray] = [m.values for m in (made.disparity, made.depth) if m is not None]
    if isinstance(made.frame, StereoFrame):
        columns += [made.frame.left, made.frame.right]
    return columns


def _clouds(converted: Converted, cloud: PointCloud) -> dict[str, PointCloud]:
    frame = converted.frame
    if not isinstance(frame, StereoFrame):
        kind = STEREO if isinstance(frame, DepthFrame) else POINTS
        return {kind: shown_points(cloud)}
    found = {STEREO: shown_points(cloud)}
    if frame.scan is not None and frame.rig.T_left_velodyne is not None:
        T_forward_scan = chain(converted.tree, cloud.frame, frame.scan.frame)
        if T_forward_scan is not None:
            found[VELODYNE] = shown_points(cloud_of_scan(frame.scan)).transformed(T_forward_scan)
    return found


def cloud_of_scan(scan: LidarScan) -> PointCloud:
    """A LiDAR's scan as a cloud, in its own frame, with the times of its points where known."""
    extra = {}
    if scan.point_times_ns is not None:
        extra = {TIME: ((scan.point_times_ns - scan.timestamp_ns) / NS_PER_S).astype(np.float32)}
    return PointCloud(
        scan.xyz, scan.frame, scan.timestamp_ns, intensity=scan.reflectance, extra=extra
    )


def shown_points(cloud: PointCloud) -> PointCloud:
    """The points of a cloud that are anywhere: finite, and no farther than the Earth is large."""
    x, y, z = np.abs(cloud.xyz.T)  # column by column: a 40th of the time of `max` along rows
    near = (x < FARTHEST_M) & (y < FARTHEST_M) & (z < FARTHEST_M)  # which NaN is not
    return cloud if near.all() and cloud.shape is None else cloud[near]


def _sight(converted: Converted, forward: str) -> Sight | None:
    frame = converted.frame
    if isinstance(frame, StereoFrame):
        T = left_in(frame.rig, forward_frame(frame.rig, forward))
        return Sight(frame.rig.left, T.matrix)
    if isinstance(frame, DepthFrame):
        T_forward_camera = chain(converted.tree, forward, frame.camera.frame)
        camera = frame.camera
        return None if T_forward_camera is None else Sight(camera, T_forward_camera.matrix)
    return None


def _in_map(converted: Converted, forward: str) -> Float64 | None:
    frame = converted.frame
    if isinstance(frame, StereoFrame | DepthFrame) and frame.pose is None:
        return None
    found: Pose | None = chain(converted.tree, MAP, forward)
    return None if found is None else np.asarray(found.matrix)
