"""A stereo cloud against the LiDAR scan of its moment: nearest neighbours in what both see."""

from __future__ import annotations

import math

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.evaluation.cloud_distances import CloudDistances, distances_between
from pseudolidar.evaluation.compared import projected
from pseudolidar.evaluation.scan_surface import seen_area
from pseudolidar.geometry.projection import project
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame


def distances_to_scan(
    cloud: PointCloud,
    frame: StereoFrame,
    *,
    range_m: tuple[float, float] = (0.0, math.inf),
    most: int | None = None,
) -> CloudDistances:
    """Nearest neighbours between a cloud and a scan, of points in the common field of view.

    Of the scan those points count that the left camera sees: in its image, and hidden by no nearer
    point (`project_scan`). Of the cloud those count whose pixel has such points around it, so
    nothing is said about the sky, about what lies above the top beam, and about what sends no beam
    back. What the cloud lacks there counts as missing, and what it has too much as a ghost. Ranges
    outside `range_m` are left out of both. Neighbours are looked for among all points of the cloud,
    and among those of the scan that the camera sees: a hidden wall excuses no ghost.

    Distances are to points and not to surfaces, so that gaps between beams (0.4 degrees from row to
    row of an HDL-64) bound accuracy from below, above all along the road.

    Args:
        cloud: of this frame, in the left camera's frame; rows may be NaN.
        frame: with a scan, and a rig that knows where the LiDAR is.
        range_m: nearest and farthest range from the left camera that the cloud may hold.
        most: ask about at most so many points of each, evenly taken.

    Raises:
        ReferenceMissing: the frame has no scan.
        CalibrationField: the rig does not know where the LiDAR is.
        StructureError: the cloud is in another frame.
    """
    rig = frame.rig
    if cloud.frame != rig.left.frame:
        raise StructureError(f"a cloud in {cloud.frame!r}", want=f"one in {rig.left.frame!r}")
    beams = projected(frame)
    inverse = np.linalg.inv(rig.left.K)
    rays = np.column_stack([beams.uv, np.ones(len(beams.uv))]) @ inverse.T
    reference = rays * beams.depth_m[:, None]
    estimate = cloud.xyz[np.isfinite(cloud.xyz).all(axis=1)].astype(np.float64)
    seen = seen_area(beams, frame.size_px)
    asked = (
        _inside(estimate, range_m) & _seen(estimate, rig.P_left, seen),
        _inside(reference, range_m),
    )
    return distances_between(estimate, reference, asked=asked, most=most)


def _inside(xyz: Float64, range_m: tuple[float, float]) -> Bool:
    range_of = np.linalg.norm(xyz, axis=1)
    return np.asarray((range_of >= range_m[0]) & (range_of <= range_m[1]), np.bool_)


def _seen(xyz: Float64, P_left: Float64, seen: Bool) -> Bool:
    """(N,) points whose pixel is in the area (H, W)."""
    height, width = seen.shape
    uv, _ = project(xyz, P_left)
    column, row = np.rint(np.nan_to_num(uv, nan=-1.0)).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    found = np.zeros(len(xyz), np.bool_)
    found[inside] = seen[row[inside].astype(np.intp), column[inside].astype(np.intp)]
    return found
