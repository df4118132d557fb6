"""The pixels behind a detection: those of its box that may be the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Bool, Float32, Float64, Int64
from pseudolidar.structures.box import Detection

# Around the middle of a box, this share of its sides shows the object most surely; what lies
# outside of that counts so much.
INNER_SHARE, RIM_WEIGHT = 0.8, 0.25
# Pixels this close to the ground belong to it, m; of a thing that stands on it.
ABOVE_GROUND_M = 0.2
# A plane that was fitted to nearer ground is not where the ground is beyond this, m: there the
# lower edge of the box tells what stands above it, to so many px.
PLANE_REACHES_M, FOOT_PX = 35.0, 3.0
# Where less than this share of the box stands above the ground, the ground is kept: it is no
# plane there, or the thing lies on it.
LEAST_STANDING = 0.05


@dataclass(frozen=True, eq=False)
class Frustum:
    """Pixels of a detection that have a depth and are no ground, row by row.

    Args:
        pixels: (N,) positions in the flat picture.
        depth_m: (N,) Z.
        sigma_m: (N,) one standard deviation of it.
        height_m: (N,) above the ground, or above the lowest pixel of the box where there is none.
        weight: (N,) how surely a pixel shows the object by its place, 0-1.
        area: pixels of the box, with and without depth, weighed likewise.
    """

    pixels: Int64
    depth_m: Float64
    sigma_m: Float64
    height_m: Float64
    weight: Float64
    area: float

    def __len__(self) -> int:
        return len(self.pixels)

    def __getitem__(self, index: Bool) -> Frustum:
        """Only those pixels."""
        return Frustum(
            self.pixels[index],
            self.depth_m[index],
            self.sigma_m[index],
            self.height_m[index],
            self.weight[index],
            self.area,
        )

    @property
    def per_depth_squared(self) -> float:
        """Sigma of the depth over its square, 1/m: what stereo has the same of at every depth."""
        return float(np.median(self.sigma_m / self.depth_m**2))


def frustum_of(sight: Sight, detection: Detection) -> Frustum:
    """The pixels behind a detection; none where nothing in it has a depth."""
    rows, columns = _window(sight, detection)
    depth = sight.depth.values[rows, columns]
    inside = np.isfinite(depth)
    if detection.mask is not None:
        inside &= detection.mask[rows, columns]
    heights = _heights_m(sight, rows, columns)
    standing = inside & (heights > ABOVE_GROUND_M)
    if sight.is_ground is not None:
        standing &= ~sight.is_ground[rows, columns]
    standing |= inside & _above_foot(sight, detection, rows, depth)
    if np.count_nonzero(standing) > LEAST_STANDING * standing.size:
        inside = standing
    weight = _weights(detection, rows, columns)
    y, x = np.nonzero(inside)
    width = sight.depth.values.shape[1]
    depth_m = depth[y, x].astype(np.float64)
    sigma_m = sight.sigma_m[rows, columns][y, x]
    return Frustum(
        pixels=((y + rows.start) * width + x + columns.start).astype(np.int64),
        depth_m=depth_m,
        sigma_m=np.maximum(sigma_m.astype(np.float64), 1e-6 * depth_m),
        height_m=heights[y, x].astype(np.float64),
        weight=weight[y, x],
        area=float(weight.sum()),
    )


def _window(sight: Sight, detection: Detection) -> tuple[slice, slice]:
    """Rows and columns of the box, as far as they lie in the picture."""
    height, width = sight.depth.values.shape
    left, top, right, bottom = detection.box_px

    def within(low: float, high: float, size: int) -> slice:
        first = int(np.clip(np.floor(low), 0, size - 1))
        return slice(first, int(np.clip(np.ceil(high), first, size - 1)) + 1)

    return within(top, bottom, height), within(left, right, width)


def _heights_m(sight: Sight, rows: slice, columns: slice) -> Float64:
    xyz = sight.xyz_in(rows, columns)
    if sight.ground is not None:
        return np.asarray(sight.ground.heights_m(xyz.reshape(-1, 3)).reshape(xyz.shape[:2]))
    up = -xyz[:, :, 1]
    lowest = np.nanmin(up) if np.isfinite(up).any() else 0.0
    return np.asarray(up - lowest + ABOVE_GROUND_M)


def _above_foot(sight: Sight, detection: Detection, rows: slice, depth: Float32) -> Bool:
    """(h, w) far pixels that are higher than where the thing of this box stands."""
    px_per_m = sight.camera.K[1, 1] / depth
    above_px = detection.box_px[3] - np.arange(rows.start, rows.stop)[:, None]
    higher = above_px > ABOVE_GROUND_M * px_per_m + FOOT_PX
    return np.asarray((depth > PLANE_REACHES_M) & higher)


def _weights(detection: Detection, rows: slice, columns: slice) -> Float64:
    """(h, w) 1 in the middle of the box, less at its rim; of a mask all alike."""
    v, u = np.mgrid[rows, columns]
    if detection.mask is not None:
        return detection.mask[rows, columns].astype(np.float64)
    left, top, right, bottom = detection.box_px
    off_u = np.abs(2 * u - left - right) / max(right - left, 1.0)
    off_v = np.abs(2 * v - top - bottom) / max(bottom - top, 1.0)
    inner = (off_u <= INNER_SHARE) & (off_v <= INNER_SHARE)
    return np.where(inner, 1.0, RIM_WEIGHT)
