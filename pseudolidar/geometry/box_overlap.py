"""How much two oriented boxes of a camera share: from above, and in space."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D


def overlaps(a: Box3D, b: Box3D) -> tuple[float, float]:
    """Intersection over union of two boxes from above and in space, 0-1.

    Both stand upright in the camera's x-z plane, as KITTI's labels do: of others the outline of
    their footprint counts.
    """
    import cv2

    first, second = _footprint(a), _footprint(b)
    shared, _ = cv2.intersectConvexConvex(first, second)
    areas = [cv2.contourArea(one) for one in (first, second)]
    heights = [_heights(one) for one in (a, b)]
    tall = max(0.0, min(h[1] for h in heights) - max(h[0] for h in heights))
    volumes = [area * (h[1] - h[0]) for area, h in zip(areas, heights, strict=True)]
    above = shared / max(sum(areas) - shared, 1e-12)
    space = shared * tall / max(sum(volumes) - shared * tall, 1e-12)
    return float(above), float(space)


def _footprint(box: Box3D) -> np.ndarray:
    """(4, 2) float32 corners in x and z, in order."""
    import cv2

    corners = box.corners_m()[:, [0, 2]].astype(np.float32)
    return np.asarray(cv2.convexHull(corners)[:, 0])


def _heights(box: Box3D) -> Float64:
    """Least and largest y."""
    y = box.corners_m()[:, 1]
    return np.array([y.min(), y.max()])
