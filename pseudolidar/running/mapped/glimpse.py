"""A frame on its way as somebody sees it who looks on: its points, where they were taken."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pseudolidar.geometry.cloud_frames import default_frame, left_in
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.frames import BASE_LINK, MAP, left_in_base_link
from pseudolidar.geometry.twists import inverted
from pseudolidar.running.products.converted import Converted
from pseudolidar.stereo.reproject import Reprojector
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import OdometryState
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class Glimpse:
    """A frame with what odometry told of it.

    Args:
        frame: as its source had it.
        disparity: of its left image.
        T_odom_camera: of its left camera, in that of the first frame; None where nothing
            was measured.
    """

    frame: StereoFrame
    disparity: DisparityMap
    T_odom_camera: Pose | None

    @classmethod
    def of(cls, frame: StereoFrame, disparity: DisparityMap, state: OdometryState) -> Glimpse:
        """A frame with what odometry told of it."""
        return cls(frame, disparity, state.measured_pose)

    def converted(self, reproject: Reprojector) -> Converted:
        """Its points, with the pose that was found in place of the source's."""
        rig = self.frame.rig
        T_base_left = left_in_base_link(rig).matrix
        pose = None
        if self.T_odom_camera is not None:
            T_map_base = T_base_left @ self.T_odom_camera.matrix @ inverted(T_base_left)
            pose = Pose(MAP, BASE_LINK, T_map_base)
        frame = replace(self.frame, pose=pose)
        cloud = reproject(frame, self.disparity).transformed(left_in(rig, default_frame(rig)))
        return Converted(frame, cloud, self.disparity, depth_map(self.disparity, rig))
