"""What of a box a camera sees: its nearest part, its outline."""

from __future__ import annotations

from functools import cache

import numpy as np

from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.box import Box3D
from pseudolidar.structures.camera import Camera

# Points along an edge; nothing nearer than this to the image plane is in view, m.
ALONG, NEAREST_M = 33, 0.1


def nearest_depth_m(box: Box3D, camera: Camera) -> float | None:
    """Smallest Z of the part of a box that projects into the picture; None where none does.

    By a grid on its faces, corners included: exact where the picture holds the box whole.
    """
    corners = box.corners_m()
    if corners[:, 2].min() > NEAREST_M and _inside(_projected(corners, camera), camera).all():
        return float(corners[:, 2].min())
    points, _ = _in_view(box, camera)
    return float(points[:, 2].min()) if len(points) else None


def seen_px(box: Box3D, camera: Camera) -> tuple[float, float, float, float] | None:
    """Left, top, right, bottom of what of a box projects into the picture; None where none does.

    Cut at its border; by a grid on its faces where part of the box is behind the camera.
    """
    _, uv = _in_view(box, camera)
    if not len(uv):
        return None
    whole = outline_px(box, camera)
    if whole is None:
        (left, top), (right, bottom) = uv.min(axis=0), uv.max(axis=0)
        whole = float(left), float(top), float(right), float(bottom)
    widest, lowest = camera.width_px - 1.0, camera.height_px - 1.0
    left, right = (min(max(u, 0.0), widest) for u in whole[::2])
    top, bottom = (min(max(v, 0.0), lowest) for v in whole[1::2])
    return left, top, right, bottom


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


def _in_view(box: Box3D, camera: Camera) -> tuple[Float64, Float64]:
    """Points on the faces of a box that project into the picture, and their pixels."""
    points = box.pose.apply(_faces() * np.array([box.length_m, box.width_m, box.height_m]))
    points = points[points[:, 2] > NEAREST_M]
    uv = _projected(points, camera)
    inside = _inside(uv, camera)
    return points[inside], uv[inside]


def _inside(uv: Float64, camera: Camera) -> Bool:
    """(N,) pixels that lie in the picture."""
    size = np.array([camera.width_px, camera.height_px])
    return np.asarray((np.abs(2 * uv - size + 1) <= size).all(axis=1))


@cache
def _faces() -> Float64:
    """(N, 3) points on the faces of a cube of edge 1 about the origin."""
    at = np.linspace(-0.5, 0.5, ALONG)
    a, b = (grid.ravel() for grid in np.meshgrid(at, at))
    sides = [
        np.insert(np.column_stack([a, b]), axis, side, axis=1)
        for axis in range(3)
        for side in (-0.5, 0.5)
    ]
    faces = np.concatenate(sides)
    faces.flags.writeable = False
    return faces


def _projected(points: Float64, camera: Camera) -> Float64:
    return np.asarray((points / points[:, 2:] @ camera.K.T)[:, :2])
