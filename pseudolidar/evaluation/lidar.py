"""Clouds and disparities against a LiDAR scan of the same moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.evaluation.compared import against_scan, projected
from pseudolidar.evaluation.ranges import RangeErrors, errors_by_range
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import DisparitySamples


@dataclass(frozen=True, eq=False)
class DepthPairs:
    """Depths of one frame where stereo and LiDAR both see something.

    Args:
        depth_m: (N,) Z of the stereo point of the pixel.
        reference_m: (N,) Z of the LiDAR point, in the left camera's frame.
        scan_points: LiDAR points in view, matched by stereo or not.
    """

    depth_m: Float64
    reference_m: Float64
    scan_points: int

    @property
    def density(self) -> float:
        """Share of the LiDAR points in view that stereo has a point for."""
        return len(self.depth_m) / self.scan_points if self.scan_points else 0.0

    def by_range(self) -> tuple[RangeErrors, ...]:
        """Relative depth errors by range; pool several frames by concatenating their arrays."""
        return errors_by_range(self.depth_m, self.reference_m)


def cloud_against_scan(cloud: PointCloud, frame: StereoFrame) -> DepthPairs:
    """Compare a cloud with the scan of its frame, pixel by pixel of the left image.

    The scan is projected into the left image without points the camera cannot see; each of its
    points is compared with the cloud's point of the nearest pixel, as far as that exists.

    Args:
        cloud: of this frame, in the left camera's frame, with `uv`.
        frame: with `scan` and a rig that knows where the LiDAR is.

    Raises:
        ReferenceMissing: the frame has no scan.
        StructureError: the cloud is in another frame, or does not know its pixels.
    """
    if cloud.uv is None or cloud.frame != frame.rig.left.frame:
        raise StructureError(
            f"a cloud in {cloud.frame!r}, {'without' if cloud.uv is None else 'with'} pixels",
            want=f"one in {frame.rig.left.frame!r} with uv",
        )
    scan = projected(frame)
    width, height = frame.size_px
    depth_of_pixel = np.full((height, width), np.nan)
    column, row = np.rint(cloud.uv).astype(np.intp).T
    depth_of_pixel[row, column] = cloud.xyz[:, 2]
    column, row = np.rint(scan.uv).astype(np.intp).T
    depth_m = depth_of_pixel[row, column]
    both = np.isfinite(depth_m)
    return DepthPairs(depth_m[both], scan.depth_m[both], len(scan.index))


def scan_samples(
    disparity: DisparityMap, frame: StereoFrame, *, frame_number: int
) -> DisparitySamples:
    """Measured disparities with those that the scan of the frame calls for.

    Raises:
        ReferenceMissing: the frame has no scan.
    """
    return against_scan(disparity, frame).samples(frame_number)
