"""One frame against its reference: every reference point in view, and what stereo says there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pseudolidar.errors import ReferenceMissing
from pseudolidar.evaluation.cloud_distances import CloudDistances
from pseudolidar.evaluation.sigma import total_sigma
from pseudolidar.geometry.projection import ProjectedScan, project_scan, px_per_radian
from pseudolidar.geometry.triangulation import (
    corrected_disparity,
    depth_from_disparity,
    disparity_from_depth,
)
from pseudolidar.structures.arrays import Bool, Float64, Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.samples import MRAD, DisparitySamples

# Slopes are taken over so many pixels to each side; what is steeper (px a px) is an edge.
SLOPE_PX, STEEPEST = 4, 0.5


@dataclass(frozen=True, eq=False)
class ComparedFrame:
    """Reference points that the left camera sees, with the disparities matched at their pixels.

    Args:
        id: the source's name of the frame.
        index: its position in the source.
        timestamp_ns: time of the picture.
        rig: of the frame, with the correction that its clouds are made with.
        u: (N,) column of the pixel that a reference point falls on, px.
        v: (N,) its row, px.
        reference_m: (N,) true depth Z in the left camera's frame, m.
        disparity_px: (N,) as matched, uncorrected; NaN where the matcher found none.
        sigma_px: (N,) the matcher's sigma; None where it states none.
        slope: (N, 2) how the disparity changes along the columns and the rows, px a px; NaN beside
            edges and holes.
        place_m: (3,) where the rig stood, of `T_map_base_link`; None where nobody knows.
        kind: what the reference is.
        distances: between the clouds of both, where the reference is one.
    """

    id: str
    index: int
    timestamp_ns: int
    rig: StereoRig
    u: Float64
    v: Float64
    reference_m: Float64
    disparity_px: Float64
    sigma_px: Float64 | None
    slope: Float64
    place_m: Float64 | None = None
    kind: Literal["scan", "truth"] = "scan"
    distances: CloudDistances | None = None

    def __len__(self) -> int:
        return len(self.reference_m)

    @property
    def matched(self) -> Bool:
        """(N,) where there is a disparity."""
        return np.isfinite(self.disparity_px)

    @property
    def corrected_px(self) -> Float64:
        """(N,) disparities without the error that the rig is known to have; NaN where none."""
        return corrected_disparity(self.disparity_px, self.u, self.v, self.rig)

    @property
    def reference_px(self) -> Float64:
        """(N,) disparities that the reference calls for."""
        return disparity_from_depth(self.reference_m, self.u, self.rig)

    @property
    def depth_m(self) -> Float64:
        """(N,) depth Z by the rig as it is; NaN without disparity and beyond infinity."""
        return depth_from_disparity(self.corrected_px, self.u, self.rig)

    @property
    def total_sigma_px(self) -> Float64 | None:
        """(N,) sigma of the disparity, the rig's systematic error included."""
        if self.sigma_px is None:
            return None
        scale = self.rig.sigma_scale.at(self.disparity_px)
        return total_sigma(self.sigma_px, self.rig.systematic_sigma_px, scale=scale)

    @property
    def per_pitch(self) -> Float64:
        """(N,) px by which the reference is too small for each mrad that its LiDAR looks too low.

        It then calls for the disparity of a place that lies higher in the picture. 0 by edges.
        """
        focal_px, centre_px = self.rig.left.K[1, 1:]
        rows = MRAD * px_per_radian(self.v - centre_px, float(focal_px))
        return np.asarray(np.nan_to_num(self.slope[:, 1]) * rows)

    def with_correction(self, correction: DisparityCorrection | None) -> ComparedFrame:
        """The same by another correction of the rig."""
        return replace(self, rig=self.rig.with_correction(correction))

    def raised(self, pitch_rad: float) -> ComparedFrame:
        """As against a LiDAR raised by a small angle: references follow the slopes about them."""
        if not pitch_rad:
            return self
        reference_px = self.reference_px + pitch_rad / MRAD * self.per_pitch
        return replace(self, reference_m=depth_from_disparity(reference_px, self.u, self.rig))

    def thinned(self, most: int) -> ComparedFrame:
        """At most so many of the points, evenly spread over the image."""
        return self.every(max(1, -(-len(self) // most)))

    def every(self, step: int) -> ComparedFrame:
        """One of so many points each, evenly over the image, and of the distances alike."""
        return replace(
            self,
            u=self.u[::step],
            v=self.v[::step],
            reference_m=self.reference_m[::step],
            disparity_px=self.disparity_px[::step],
            sigma_px=None if self.sigma_px is None else self.sigma_px[::step],
            slope=self.slope[::step],
            distances=None if self.distances is None else self.distances.every(step),
        )

    def samples(self, frame_number: int | None = None) -> DisparitySamples:
        """The matched points, uncorrected, numbered `frame_number` or by the frame's index."""
        matched = self.matched
        number = self.index if frame_number is None else frame_number
        return DisparitySamples(
            measured=self.disparity_px[matched],
            reference=self.reference_px[matched],
            u=self.u[matched],
            v=self.v[matched],
            frame=np.full(int(matched.sum()), number, np.int64),
            size_px=self.rig.left.size_px,
            sigma=None if self.sigma_px is None else self.sigma_px[matched],
            per_pitch=self.per_pitch[matched] if self.kind == "scan" else None,
        )


def against_scan(disparity: DisparityMap, frame: StereoFrame) -> ComparedFrame:
    """Compare a disparity map with the LiDAR scan of its frame.

    The scan is projected into the left image without the points that the camera cannot see.

    Args:
        disparity: of this frame, as matched.
        frame: with `scan` and a rig that knows where the LiDAR is.

    Raises:
        ReferenceMissing: the frame has no scan.
        CalibrationField: the rig does not know where the LiDAR is.
    """
    scan = projected(frame)
    column, row = np.rint(scan.uv).astype(np.intp).T
    return _compared(disparity, frame, column, row, scan.depth_m)


def against_truth(
    disparity: DisparityMap, frame: StereoFrame, *, most: int | None = None
) -> ComparedFrame:
    """Compare a disparity map with the ground-truth disparity of its frame.

    Args:
        disparity: of this frame, as matched.
        frame: with `truth`.
        most: keep at most so many pixels, evenly spread.

    Raises:
        ReferenceMissing: the frame has no ground truth.
    """
    if frame.truth is None:
        raise ReferenceMissing(
            f"frame {frame.id} has no ground-truth disparity",
            want="a source with ground truth, such as KITTI stereo 2015 training data",
        )
    row, column = np.nonzero(frame.truth.valid)
    step = 1 if most is None else max(1, -(-len(row) // most))
    row, column = row[::step], column[::step]
    true_px = frame.truth.values[row, column].astype(np.float64)
    depth_m = depth_from_disparity(true_px, column.astype(np.float64), frame.rig)
    near = np.isfinite(depth_m)
    compared = _compared(disparity, frame, column[near], row[near], depth_m[near])
    return replace(compared, kind="truth")


def projected(frame: StereoFrame) -> ProjectedScan:
    """The scan of a frame as its left camera sees it.

    Raises:
        ReferenceMissing: the frame has no scan.
        CalibrationField: the rig does not know where the LiDAR is.
    """
    if frame.scan is None:
        raise ReferenceMissing(
            f"frame {frame.id} has no LiDAR scan",
            want="a source with a Velodyne scan of each frame",
        )
    return project_scan(frame.scan, frame.rig)


def _compared(
    disparity: DisparityMap,
    frame: StereoFrame,
    column: Int64,
    row: Int64,
    reference_m: Float64,
) -> ComparedFrame:
    sigma = disparity.sigma
    return ComparedFrame(
        id=frame.id,
        index=frame.index,
        timestamp_ns=frame.timestamp_ns,
        rig=frame.rig,
        u=column.astype(np.float64),
        v=row.astype(np.float64),
        reference_m=reference_m,
        disparity_px=disparity.values[row, column].astype(np.float64),
        sigma_px=None if sigma is None else sigma[row, column].astype(np.float64),
        slope=np.stack([_slope(disparity, column, row, axis) for axis in ((1, 0), (0, 1))], axis=1),
        place_m=None if frame.pose is None else frame.pose.translation_m,
    )


def _slope(disparity: DisparityMap, column: Int64, row: Int64, axis: tuple[int, int]) -> Float64:
    """(N,) change of the disparity along an axis, over pixels that hang together."""
    height, width = disparity.values.shape

    def at(steps: int) -> Float64:
        u, v = column + steps * axis[0], row + steps * axis[1]
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        found = disparity.values[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
        return np.where(inside, found.astype(np.float64), np.nan)

    sides = np.stack([at(SLOPE_PX) - at(0), at(0) - at(-SLOPE_PX)]) / SLOPE_PX
    sides[np.abs(sides) >= STEEPEST] = np.nan
    known = np.isfinite(sides)
    total = np.where(known, sides, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / known.sum(axis=0))
