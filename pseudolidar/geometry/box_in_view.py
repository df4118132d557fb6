"""What of a box a camera sees: its nearest part, its outline."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D
from pseudolidar.structures.camera import Camera

# Points along an edge; nothing nearer than this to the image plane is in view, m.
ALONG, NEAREST_M = 33, 0.1


def nearest_depth_m(box: Box3D, camera: Camera) -> float | None:
    """Smallest Z of the part of a box that projects into the picture; None where none does.

    By a grid on its faces, corners included: exact where the picture holds the box whole.
    """
    points = box.pose.apply(_faces() * np.array([box.length_m, box.width_m, box.height_m]))
    points = points[points[:, 2] > NEAREST_M]
    u, v = _projected(points, camera).T
    inside = (np.abs(2 * u - camera.width_px + 1) <= camera.width_px) & (
        np.abs(2 * v - camera.height_px + 1) <= camera.height_px
    )
    return float(points[inside, 2].min()) if inside.any() else None


def outline_px(box: Box3D, camera: Camera) -> tuple[float, float, float, float] | None:
    """Left, top, right, bottom of a box in the picture, uncut; None where it is behind."""
    corners = box.corners_m()
    if corners[:, 2].min() <= NEAREST_M:
        return None
    uv = _projected(corners, camera)
    (left, top), (right, bottom) = uv.min(axis=0), uv.max(axis=0)
    return float(left), float(top), float(right), float(bottom)


def across_m(box: Box3D) -> float:
    """How wide a box is as seen: between its outer edges in the picture, at their distance, m.

    What lies behind them, of which nothing may be seen, does not count.
    """
    x, _, z = box.corners_m().T
    bearing = x / np.maximum(z, NEAREST_M)
    left, right = int(np.argmin(bearing)), int(np.argmax(bearing))
    return float((bearing[right] - bearing[left]) * 0.5 * (z[left] + z[right]))


def _faces() -> Float64:
    """(N, 3) points on the faces of a cube of edge 1 about the origin."""
    at = np.linspace(-0.5, 0.5, ALONG)
    a, b = (grid.ravel() for grid in np.meshgrid(at, at))
    sides = [
        np.insert(np.column_stack([a, b]), axis, side, axis=1)
        for axis in range(3)
        for side in (-0.5, 0.5)
    ]
    return np.concatenate(sides)


def _projected(points: Float64, camera: Camera) -> Float64:
    return np.asarray((points / points[:, 2:] @ camera.K.T)[:, :2])
