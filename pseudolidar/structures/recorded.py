"""Frames that a source holds already measured: depth beside a picture, or points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Image, check_array
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.frame import LidarScan, RawPair, StereoFrame
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A picture with the depth of its pixels, as depth cameras and networks for one eye make it.

    Args:
        image: (H, W) grey or (H, W, 3) RGB, uint8 or uint16.
        depth: (H, W) of the same pixels.
        camera: without lens distortion, of the same image size.
        id: the source's name of the frame; names its output files.
        index: position in the source.
        timestamp_ns: time of the picture.
        pose: `T_map_base_link`, where the source knows it.
        notes: what was odd about it, for the report.

    Raises:
        StructureError: image and depth differ in size.
        CalibrationSizeMismatch: the camera was calibrated for another image size.
    """

    image: Image
    depth: DepthMap
    camera: Camera
    id: str
    index: int
    timestamp_ns: int
    pose: Pose | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (None, None, 3) if self.image.ndim == 3 else (None, None)
        check_array("DepthFrame", "image", self.image, shape, np.uint8, np.uint16)
        if self.depth.values.shape != self.image.shape[:2]:
            raise StructureError(
                f"depth of shape {self.depth.values.shape}",
                want=f"{self.image.shape[:2]}, the image's",
                where=f"frame {self.id}",
            )
        height, width = self.image.shape[:2]
        self.camera.check_size(width, height)

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.image.shape[1], self.image.shape[0]


@dataclass(frozen=True, eq=False)
class RecordedCloud:
    """A cloud that a source holds, ready made, with what is known about where it stands.

    Args:
        cloud: the points with all columns that they were recorded with.
        id: the source's name of the frame; names its output files.
        index: position in the source.
        timestamp_ns: time of the cloud.
        tree: `T_parent_child` of the coordinate frames that the source knows at that time.
        scan: LiDAR scan of the same moment.
        notes: what was odd about it, for the report.
    """

    cloud: PointCloud
    id: str
    index: int
    timestamp_ns: int
    tree: tuple[Pose, ...] = ()
    scan: LidarScan | None = None
    notes: tuple[str, ...] = ()


Frame: TypeAlias = StereoFrame | DepthFrame | RecordedCloud | BodyFrame
# What sources hold; unrectified pairs become frames as they are loaded.
HeldFrame: TypeAlias = Frame | RawPair
