"""What is kept of a keyframe so that its place is known again: points, and depths in coarse cells.

No picture is kept: about 25 kB a keyframe, on disk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pseudolidar.geometry.corners import spread_corners
from pseudolidar.geometry.grey import grey8_left
from pseudolidar.geometry.triangulation import corrected_disparity
from pseudolidar.structures.arrays import Bool, Float32, Float64, UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.loop import LoopEnd

Float16 = npt.NDArray[np.float16]

# Corners in each of the picture's cells, and the most that are kept.
PER_CELL, MOST_POINTS = 6, 600
# Corners of wider pictures are found at half the size: a quarter of the time.
HALVED_FROM_PX = 800
# Depths are kept as medians of square cells: of every so many pixels across and down, if enough of
# them have one.
CELL_PX, LEAST_SHARE, STEP = 16, 0.5, 4
# Smaller disparities say nothing of how far a point is, px.
LEAST_PX = 1.0
# Side of the patch that ORB describes, and how near to the border it still does, px.
PATCH_PX, BORDER_PX = 31, 16


@dataclass(frozen=True, eq=False)
class Place:
    """A keyframe as it is remembered.

    Args:
        number: of the place, counted from the first.
        end: which frame it was.
        T_odom_camera: (4, 4) where odometry had it.
        along_m: path from the piece's beginning.
        uv: (N, 2) float32 px, points of the left picture.
        d: (N,) float32 px, their disparities, corrected.
        descriptors: (N, 32) uint8, ORB's.
        depth_cells_m: (h, w) float16 m, medians of cells, NaN where unknown.
        grey_cells: (h, w) uint8, mean grey of the same cells.
    """

    number: int
    end: LoopEnd
    T_odom_camera: Float64
    along_m: float
    uv: Float32
    d: Float32
    descriptors: UInt8
    depth_cells_m: Float16
    grey_cells: UInt8

    def __len__(self) -> int:
        return len(self.d)


def described(
    frame: StereoFrame, disparity: DisparityMap, rig: StereoRig, *, movable: Bool | None = None
) -> tuple[Float32, Float32, UInt8]:
    """Points of a left picture with disparities and ORB descriptors.

    Args:
        frame: of any rig of that size.
        disparity: of its left image, as matched.
        rig: its correction is taken off.
        movable: (H, W) pixels of things that may move by themselves.

    Returns:
        uv (N, 2) px, d (N,) px, descriptors (N, 32).

    Source: Rublee et al., ORB: an efficient alternative to SIFT or SURF, ICCV 2011.
    """
    import cv2

    grey = grey8_left(frame.left, frame.right)
    uv = _corners(grey)
    column, row = uv.astype(np.intp).T
    u, v = uv.astype(np.float64).T
    d = corrected_disparity(disparity.values[row, column].astype(np.float64), u, v, rig)
    with np.errstate(invalid="ignore"):
        known = d + rig.doffs_px > LEAST_PX
    if movable is not None:
        known &= ~movable[row, column]
    uv, d = uv[known], d[known]
    points = [cv2.KeyPoint(float(u), float(v), PATCH_PX, class_id=i) for i, (u, v) in enumerate(uv)]
    keys, descriptors = cv2.ORB.create(
        MOST_POINTS, edgeThreshold=BORDER_PX, patchSize=PATCH_PX
    ).compute(grey, points)
    kept = np.array([key.class_id for key in keys], np.intp)
    if descriptors is None or not len(kept):
        descriptors = np.zeros((0, 32), np.uint8)
    return uv[kept], d[kept].astype(np.float32), np.asarray(descriptors, np.uint8)


def _corners(grey: UInt8) -> Float32:
    """(N, 2) whole px, spread over the picture; of large ones found at half the size."""
    import cv2

    if grey.shape[1] < HALVED_FROM_PX:
        return spread_corners(grey, per_cell=PER_CELL)
    return np.asarray(
        2 * spread_corners(np.asarray(cv2.pyrDown(grey), np.uint8), per_cell=PER_CELL)
    )


def depth_cells(disparity: DisparityMap, rig: StereoRig) -> Float32:
    """(h, w) m, median depths of cells, NaN where few pixels have one."""
    height, width = (size // CELL_PX for size in disparity.values.shape)
    values = disparity.values[: height * CELL_PX, : width * CELL_PX]
    blocks = values.reshape(height, CELL_PX, width, CELL_PX).swapaxes(1, 2)
    # A few pixels tell the median as well; NaN are sorted last.
    ordered = np.sort(
        blocks[:, :, ::STEP, ::STEP].reshape(height, width, -1), axis=2
    )  # NaN go last
    known = np.isfinite(ordered).sum(axis=2)
    middle = np.take_along_axis(ordered, (known // 2)[:, :, None], axis=2)[:, :, 0]
    u, v = cell_centres((height, width))
    measured = middle.astype(np.float64).ravel()
    d = corrected_disparity(measured, u.ravel(), v.ravel(), rig).reshape(height, width)
    d = d + rig.doffs_px
    enough = known >= LEAST_SHARE * ordered.shape[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(enough & (d > LEAST_PX), rig.fB_px_m / d, np.nan).astype(np.float32)


def grey_cells(frame: StereoFrame) -> UInt8:
    """(h, w) mean grey of the left picture's cells."""
    import cv2

    grey = grey8_left(frame.left, frame.right)
    height, width = (size // CELL_PX for size in grey.shape)
    whole = grey[: height * CELL_PX, : width * CELL_PX]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def cell_centres(shape: tuple[int, int]) -> tuple[Float64, Float64]:
    """U and v (h, w) px of the middles of cells."""
    v, u = (np.indices(shape) + 0.5) * CELL_PX - 0.5
    return u, v
