"""The points of a cloud as their rig measures them, and what beams make of their disparities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.clouds.correct_graph import Known, SurfaceGraph
from pseudolidar.clouds.correct_rig import rig_error
from pseudolidar.geometry.projection import project_scan
from pseudolidar.geometry.triangulation import (
    depth_from_disparity,
    depth_per_disparity,
    disparity_from_depth,
)
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.frame import StereoFrame

# LiDAR and stereo disagree by more than this where they see different surfaces, px.
SAME_SURFACE_PX = 8.0
# How well a projected LiDAR point is known in disparity, px: 2 cm along the beam, and calibration
# and motion that put it some pixels aside. 0.1 and 0.5 change KITTI errors by 0.05 %.
LIDAR_PX = 0.25
# Matching error where the cloud does not state one, px (68 %, median of KITTI).
UNSTATED_PX = 0.3
# Systematic error that is left where beams are near, px (68 %): sigma then holds as many errors as
# on a refined rig (KITTI: 80-90 % within it, 97-99 % within its 95 % radius).
LEFT_PX = 0.1
# The beams of one frame carry no more terms of the rig's error than these, the first ones.
TERMS_OF_BEAMS = 8


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """The points of a cloud that are there, as the rig measures them.

    Args:
        rig: of the frame.
        row: (N,) int64 in the cloud.
        u: (N,) column, px.
        v: (N,) row, px.
        d: (N,) disparity, corrected as far as the rig knows its error, px.
        sigma: (N,) px, of matching alone.
    """

    rig: StereoRig
    row: Int64
    u: Float64
    v: Float64
    d: Float64
    sigma: Float64

    @classmethod
    def of(cls, cloud: PointCloud, rig: StereoRig) -> MeasuredPoints:
        """Of a cloud with pixels, in the left camera's frame."""
        assert cloud.uv is not None
        row = np.flatnonzero(cloud.valid & (cloud.xyz[:, 2] > 0))
        u, v = cloud.uv[row].astype(np.float64).T
        depth_m = cloud.xyz[row, 2].astype(np.float64)
        d = disparity_from_depth(depth_m, u, rig)
        if cloud.sigma_m is None:
            return cls(rig, row, u, v, d, np.full(len(row), UNSTATED_PX))
        along = np.linalg.norm(cloud.xyz[row].astype(np.float64), axis=1) / depth_m
        total = cloud.sigma_m[row] / (along * depth_per_disparity(d, depth_m, rig))
        matching = np.sqrt(np.maximum(total**2 - rig.systematic_sigma_px**2, 0.0))
        return cls(rig, row, u, v, d, np.where(np.isfinite(matching), matching, UNSTATED_PX))

    def known(self, frame: StereoFrame) -> tuple[Known, int]:
        """What the scan calls for at the pixels that have a point, and its points in view."""
        assert frame.scan is not None
        scan = project_scan(frame.scan, self.rig)
        width, height = frame.size_px
        at_pixel = np.full((height, width), -1, np.int64)
        column, row = np.rint(np.stack([self.u, self.v])).astype(np.intp)
        at_pixel[row, column] = np.arange(len(self.row))
        column, row = np.rint(scan.uv).astype(np.intp).T
        point = at_pixel[row, column]
        both = point >= 0
        point = point[both]
        wanted = disparity_from_depth(scan.depth_m[both], self.u[point], self.rig)
        change = wanted - self.d[point]
        same = np.abs(change) < SAME_SURFACE_PX
        point, change = point[same], change[same]
        known = Known(point, change, np.hypot(self.sigma[point], LIDAR_PX))
        return known, len(scan.index)

    def corrected(self, known: Known, neighbours: int) -> tuple[Float64, Float64, Float64]:
        """(N,) change of the disparity, px; how far beams tell it; systematic error left, px."""
        features = DisparityCorrection.features(self.d, self.u, self.v, self.rig.left.size_px)
        features = features[:, :TERMS_OF_BEAMS]
        systematic_px = self.rig.systematic_sigma_px
        error = rig_error(
            features[known.point], known.value, known.sigma, systematic_px=systematic_px
        )
        smooth, smooth_px = error.at(features)
        d = self.d + smooth
        graph = SurfaceGraph.of(
            self.u, self.v, d, width_px=self.rig.left.width_px, neighbours=neighbours
        )
        rest = replace(known, value=known.value - smooth[known.point])
        local, share = graph.spread(rest)
        least = min(LEFT_PX, systematic_px)
        alone = np.clip(smooth_px, least, max(least, systematic_px))
        return smooth + local, share, np.hypot((1 - share) * alone, share * least)

    def moved(self, cloud: PointCloud, change: Float64, left_px: Float64) -> PointCloud:
        """The cloud with its points along their rays at the changed disparities.

        Where a disparity would pass infinity the point stays where it was.
        """
        d = self.d + change
        depth_m = depth_from_disparity(d, self.u, self.rig)
        before_m = cloud.xyz[self.row, 2].astype(np.float64)
        lost = ~(depth_m > 0)
        depth_m[lost], d[lost] = before_m[lost], self.d[lost]
        xyz = cloud.xyz.copy()
        xyz[self.row] *= (depth_m / before_m)[:, None].astype(xyz.dtype)
        if cloud.sigma_m is None:
            return replace(cloud, xyz=xyz)
        along = np.linalg.norm(xyz[self.row].astype(np.float64), axis=1) / depth_m
        total = np.hypot(self.sigma, left_px) * along
        sigma_m = cloud.sigma_m.copy()
        sigma_m[self.row] = total * depth_per_disparity(d, depth_m, self.rig)
        return replace(cloud, xyz=xyz, sigma_m=sigma_m)
