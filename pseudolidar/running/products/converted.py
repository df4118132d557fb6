"""What a frame has become on its way through a conversion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from pseudolidar.clouds.tool import CloudTools, seen_in
from pseudolidar.geometry.cloud_frames import forward_frame, left_in, turned_forward
from pseudolidar.geometry.frames import camera_tree, frame_tree
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud


@dataclass(frozen=True, eq=False)
class Converted:
    """What a frame has become.

    Args:
        frame: as its source had it.
        cloud: points in the frame that clouds are handed over in.
        disparity: of the left image of a pair.
        depth: of the left image, or of the only one.
        counts: what filters and tools did, by name, for the report.
        removed: (H, W) why cleaning removed a pixel, as `stereo.filters.clean.Cleaned.reason`.
    """

    frame: Frame
    cloud: PointCloud
    disparity: DisparityMap | None = None
    depth: DepthMap | None = None
    counts: Mapping[str, float] = field(default_factory=dict)
    removed: UInt8 | None = None

    @property
    def forward_cloud(self) -> PointCloud:
        """The cloud with x forward, for formats that mean nothing else."""
        if isinstance(self.frame, StereoFrame) and self.cloud.frame == self.frame.rig.left.frame:
            rig = self.frame.rig
            return self.cloud.transformed(left_in(rig, forward_frame(rig, "camera_left")))
        return turned_forward(self.cloud)

    @property
    def tree(self) -> tuple[Pose, ...]:
        """`T_parent_child` of all that is known about coordinate frames, and who saw the cloud."""
        match self.frame:
            case StereoFrame() as pair:
                return frame_tree(pair.rig, pair.pose)
            case DepthFrame(camera=camera, pose=pose):
                return seen_in(camera.frame, camera_tree(camera, pose))
            case RecordedCloud(cloud=cloud, tree=tree):
                return seen_in(cloud.frame, tree)
            case BodyFrame():  # has become the cloud of its pairs
                return seen_in(self.cloud.frame, ())

    def tooled(self, tools: CloudTools) -> Self:
        """The same with what `tools` make of its cloud, and their figures among the counts."""
        cloud, figures = tools(self.cloud, self.tree)
        return replace(self, cloud=cloud, counts={**self.counts, **figures})
