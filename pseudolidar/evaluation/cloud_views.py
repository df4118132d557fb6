"""Clouds as pictures: from above and in perspective, the nearest point in front."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.pictures import NOTHING
from pseudolidar.structures.arrays import Float64, Int64, UInt8
from pseudolidar.structures.cloud import PointCloud

# A point is drawn as large as it is, but not larger than this, px.
LARGEST_DOT_PX = 5
# Shares of the points' coordinates that lie outside of a view from above.
OUTSIDE = 0.002
# Nothing nearer to the eye is drawn, m.
NEAREST_M = 0.5
UNCOLOURED = 200
# A way that is drawn from above: its colour, its width, and how far the view goes beyond it, m.
WAY_RGB, WAY_PX, WAY_MARGIN_M = (255, 140, 0), 3, 0.5


@dataclass(frozen=True)
class Eye:
    """Where a cloud is looked at from; z is up.

    Args:
        at_m: (3,) where the eye is.
        towards_m: (3,) what it looks at.
        width_px: of the picture.
        height_px: of the picture.
        angle_deg: across the picture.
    """

    at_m: tuple[float, float, float]
    towards_m: tuple[float, float, float]
    width_px: int = 1200
    height_px: int = 675
    angle_deg: float = 70.0

    @property
    def focal_px(self) -> float:
        """Focal length."""
        return self.width_px / 2 / float(np.tan(np.radians(self.angle_deg) / 2))

    def axes(self) -> Float64:
        """(3, 3) rows: right, down, ahead, in the cloud's frame."""
        ahead = np.subtract(self.towards_m, self.at_m)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(ahead, right), ahead])


def perspective(
    cloud: PointCloud, eye: Eye, *, point_m: float, largest_px: int = LARGEST_DOT_PX
) -> UInt8:
    """(H, W, 3) RGB of a cloud as an eye sees it.

    Args:
        cloud: z up.
        eye: from where.
        point_m: side of a point.
        largest_px: no point is drawn larger.
    """
    seen = (cloud.xyz - np.asarray(eye.at_m)) @ eye.axes().T
    depth = seen[:, 2]
    front = np.flatnonzero(depth > NEAREST_M)
    scale = eye.focal_px / depth[front]
    u = eye.width_px / 2 + seen[front, 0] * scale
    v = eye.height_px / 2 + seen[front, 1] * scale
    dots = np.clip(np.ceil(point_m * scale), 1, largest_px).astype(np.int64)
    return _splatted(cloud, front, (u, v), -depth[front], dots, (eye.height_px, eye.width_px))


def from_above(
    cloud: PointCloud,
    *,
    point_m: float,
    gap_m: float = 0.0,
    way: Float64 | None = None,
    width_px: int = 1200,
    tallest_px: int = 1200,
) -> tuple[UInt8, float]:
    """(H, W, 3) RGB of a cloud from above, x to the right, the highest point in front.

    Args:
        cloud: z up.
        point_m: side of a point.
        gap_m: gaps between points that are no wider are filled with what is beside them.
        way: (N, 2) places that are joined by a line, a dot at the first; all of them are in view.
        width_px: of the picture at most.
        tallest_px: of the picture at most.

    Returns:
        The picture, and m a pixel.
    """
    xy = cloud.xyz[:, :2]
    low, high = np.quantile(xy, (OUTSIDE, 1 - OUTSIDE), axis=0)
    if way is not None:
        low = np.minimum(low, way.min(axis=0) - WAY_MARGIN_M)
        high = np.maximum(high, way.max(axis=0) + WAY_MARGIN_M)
    size_m = np.maximum(high - low, 1.0)
    per_px = float(max(size_m[0] / width_px, size_m[1] / tallest_px))
    width, height = (max(int(np.ceil(edge / per_px)), 1) for edge in size_m)
    u, v = (xy[:, 0] - low[0]) / per_px, (high[1] - xy[:, 1]) / per_px
    every = np.arange(len(cloud))
    side = int(np.clip(np.ceil(point_m / per_px), 1, LARGEST_DOT_PX))
    dots = np.full(len(cloud), side, np.int64)
    filled = np.full(len(cloud), int(np.ceil(gap_m / per_px)), np.int64)
    shape = (height, width)
    picture = _splatted(cloud, every, (u, v), cloud.xyz[:, 2], dots, shape, beneath=filled)
    if way is not None:
        _draw_way(picture, np.stack([way[:, 0] - low[0], high[1] - way[:, 1]], axis=1) / per_px)
    return picture, per_px


def _draw_way(picture: UInt8, uv: Float64) -> None:
    """A line along places (N, 2) px, and a dot at the first."""
    import cv2

    places = np.rint(uv).astype(np.int32)
    cv2.polylines(picture, [places[:, None]], False, WAY_RGB, WAY_PX, cv2.LINE_AA)
    begin = int(places[0, 0]), int(places[0, 1])
    cv2.circle(picture, begin, 2 * WAY_PX, WAY_RGB, cv2.FILLED, cv2.LINE_AA)


def _splatted(
    cloud: PointCloud,
    chosen: Int64,
    uv: tuple[Float64, Float64],
    nearness: Float64,
    dots: Int64,
    shape: tuple[int, int],
    *,
    beneath: Int64 | None = None,
) -> UInt8:
    """Points as squares; what is nearer covers what is behind it, and what is `beneath` nothing."""
    from pseudolidar.evaluation.splat_kernel import splat

    picture = np.full((*shape, 3), NOTHING, np.uint8)
    rgb = np.full((len(cloud), 3), UNCOLOURED, np.uint8) if cloud.rgb is None else cloud.rgb
    front = np.full(shape, -np.inf)
    u, v, near = (np.ascontiguousarray(axis, np.float64) for axis in (*uv, nearness))
    colours = np.ascontiguousarray(rgb[chosen])
    if beneath is not None:
        splat(picture, front, u, v, near, beneath, colours)
        front[:] = -np.inf
    splat(picture, front, u, v, near, dots, colours)
    return picture
