"""Points followed from one stereo pair to another, across the eyes and over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.corners import spread_corners
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.geometry.lucas_kanade import follow, follow_both_ways
from pseudolidar.geometry.pnp import RelativePose, first_pose, refined_pose
from pseudolidar.geometry.projection import project
from pseudolidar.geometry.triangulation import points_by_q
from pseudolidar.geometry.warping import NEAREST_M, Warp
from pseudolidar.structures.arrays import Bool, Float32, Float64, UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.point_tracks import PointTracks

# Corners in each cell of the image, when a motion is first found and when it is made precise.
CORNERS_FIRST, CORNERS_PRECISE = 10, 14
# Windows that are compared across the eyes and over time, px.
WINDOW_ACROSS_PX, WINDOW_OVER_TIME_PX = 15, 21
LEVELS_FIRST, LEVELS_WARPED = 3, 1
# A point followed there and back must return to this, px.
RETURNS_FIRST_PX, RETURNS_WARPED_PX = 0.5, 0.3
# The other eye sees a point within so many rows, and so near to the disparity that was matched, px.
MAX_ROWS_PX, MAX_FROM_MATCHED_PX = 2.0, 1.5
# In a warped picture all points have almost come to rest, px: those that can be followed at all are
# found in a few iterations.
MAX_WARPED_SHIFT_PX, ITERATIONS_WARPED = 4.0, 10
# Smaller disparities (plus doffs) are as good as infinite, px; they start no track.
LEAST_PX = 0.7
# A prediction farther off than this is none, px.
MAX_PREDICTED_SHIFT_PX = 250.0


@dataclass(frozen=True, eq=False)
class MatchedPair:
    """A rectified pair with the disparities of its left image.

    Args:
        left: (H, W) uint8 grey.
        right: (H, W) uint8 grey.
        disparity: (H, W) float32 px, NaN where unknown.
    """

    left: UInt8
    right: UInt8
    disparity: Float32

    @classmethod
    def of(cls, frame: StereoFrame, disparity: DisparityMap) -> MatchedPair:
        """The pictures of a frame in grey."""
        return cls(*grey8_pair(frame.left, frame.right), disparity.values)

    def disparity_at(self, uv: Float32) -> Float32:
        """(N,) disparity px of the pixels nearest to (N, 2) uv, NaN where unknown."""
        height, width = self.disparity.shape
        column, row = np.rint(uv).astype(np.intp).T
        near = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        return np.asarray(self.disparity[near])


@dataclass(frozen=True, eq=False)
class AcrossEyes:
    """Points of the left image found in the right one.

    Args:
        d: (N,) float64 px, to a fraction of a pixel; may be negative.
        rows: (N,) float64 px that a point lies lower in the right image.
        found: (N,) where there is one.
    """

    d: Float64
    rows: Float64
    found: Bool


def across(left: UInt8, right: UInt8, uv: Float32, d: Float32, *, levels: int = 0) -> AcrossEyes:
    """Find points of the left image in the right one, near the disparities `d` (N,)."""
    guess = np.column_stack([uv[:, 0] - d, uv[:, 1]]).astype(np.float32)
    in_right, found = follow(left, right, uv, guess, window_px=WINDOW_ACROSS_PX, levels=levels)
    shift = (uv - in_right).astype(np.float64)
    return AcrossEyes(shift[:, 0], -shift[:, 1], found)


@dataclass(frozen=True, eq=False)
class Seeds:
    """Corners of a left image that the right one shows too.

    Args:
        uv: (N, 2) float32 px, cell by cell of the image, strongest first.
        d: (N,) float64 px, as measured.
    """

    uv: Float32
    d: Float64

    def __len__(self) -> int:
        return len(self.d)

    def __getitem__(self, index: Bool | slice) -> Seeds:
        """The chosen ones."""
        return Seeds(self.uv[index], self.d[index])

    @classmethod
    def of(cls, pair: MatchedPair, rig: StereoRig, per_cell: int) -> Seeds:
        """Those that the right eye sees where the matched disparity says."""
        uv = spread_corners(pair.left, per_cell=per_cell)
        matched = pair.disparity_at(uv)
        uv, matched = (column[matched + rig.doffs_px > LEAST_PX] for column in (uv, matched))
        seen = across(pair.left, pair.right, uv, matched)
        good = seen.found & (np.abs(seen.rows) < MAX_ROWS_PX)
        good &= np.abs(seen.d - matched) < MAX_FROM_MATCHED_PX
        good &= seen.d + rig.doffs_px > LEAST_PX / 2
        return cls(uv[good], seen.d[good])


def track(
    first: MatchedPair,
    second: MatchedPair,
    rig: StereoRig,
    T_to_from: Float64,
    *,
    seeds: Seeds | None = None,
) -> PointTracks:
    """Corners of the first pair that the second one shows too, where the motion is not well known.

    Args:
        first: the earlier pair.
        second: of the same size.
        rig: rectified.
        T_to_from: (4, 4) a guess of the motion, such as that of the pairs before.
        seeds: the corners of the first pair to follow; None to look for them.
    """
    seeds = Seeds.of(first, rig, CORNERS_FIRST) if seeds is None else seeds
    uv, d = seeds.uv, seeds.d
    guess = _predicted(uv, d, rig, T_to_from)
    there, found = follow_both_ways(
        first.left,
        second.left,
        uv,
        guess,
        window_px=WINDOW_OVER_TIME_PX,
        levels=LEVELS_FIRST,
        within_px=RETURNS_FIRST_PX,
    )
    uv, d, there = uv[found], d[found], there[found]
    d_there = second.disparity_at(there)
    after = across(second.left, second.right, there, np.where(np.isfinite(d_there), d_there, d))
    good = after.found & (np.abs(after.rows) < MAX_ROWS_PX) & (after.d + rig.doffs_px > 0)
    good &= ~(np.abs(after.d - d_there) >= MAX_FROM_MATCHED_PX)
    return _tracks(uv, d, there, after.d, good)


def track_warped(
    first: MatchedPair,
    second: MatchedPair,
    rig: StereoRig,
    T_to_from: Float64,
    *,
    seeds: Seeds | None = None,
    correction: DisparityCorrection | None = None,
) -> PointTracks:
    """Many more corners, more precisely, where the motion is known well.

    The second pair is resampled as the first one would see it: windows then look alike however far
    the camera went, and points move by fractions of a pixel.

    Args:
        first: the earlier pair.
        second: of the same size.
        rig: rectified; its own correction is not used.
        T_to_from: (4, 4) the motion, right to a few pixels.
        seeds: corners of the first pair, where they are known already.
        correction: systematic error of the disparities, for the resampling; tracks are as measured.
    """
    seeds = Seeds.of(first, rig, CORNERS_PRECISE) if seeds is None else seeds
    uv, d = seeds.uv, seeds.d
    warp = Warp.by(first.disparity, rig, T_to_from, correction)
    left, right = warp.left(second.left), warp.right(second.right)
    at, found = follow_both_ways(
        first.left,
        left,
        uv,
        uv,
        window_px=WINDOW_OVER_TIME_PX,
        levels=LEVELS_WARPED,
        within_px=RETURNS_WARPED_PX,
        iterations=ITERATIONS_WARPED,
    )
    found &= np.linalg.norm(at - uv, axis=1) < MAX_WARPED_SHIFT_PX
    uv, d, at = uv[found], d[found], at[found]
    in_right, seen = follow(
        left, right, at, at, window_px=WINDOW_OVER_TIME_PX, iterations=ITERATIONS_WARPED
    )
    apart = np.abs(in_right - at)
    seen &= (apart[:, 1] < MAX_ROWS_PX) & (apart[:, 0] < MAX_FROM_MATCHED_PX)
    there = warp.at(at)
    d_there = there[:, 0] - warp.at(in_right)[:, 2]
    height, width = first.left.shape
    seen &= np.all((there[:, :2] > 0) & (there[:, :2] < (width - 1, height - 1)), axis=1)
    seen &= d_there + rig.doffs_px > 0
    return _tracks(uv, d, there[:, :2], d_there, seen)


def relative_pose(
    first: MatchedPair,
    second: MatchedPair,
    rig: StereoRig,
    guess: Float64,
    *,
    seeds: Seeds | None = None,
) -> RelativePose | None:
    """How the camera moved from one pair to another, from a rough guess or none.

    Args:
        first: the earlier pair.
        second: of the same size.
        rig: rectified.
        guess: (4, 4) `T_to_from`, such as the motion before; the identity where nothing is known.
        seeds: the corners of the first pair to follow; None to look for them.

    Returns:
        None where too few points agree on a motion.
    """
    tracks = track(first, second, rig, guess, seeds=seeds)
    rough = first_pose(tracks, rig)
    return None if rough is None else refined_pose(rough, tracks, rig)


def precise_pose(
    first: MatchedPair, second: MatchedPair, rig: StereoRig, T_to_from: Float64
) -> RelativePose | None:
    """The motion `T_to_from` made precise by points of warped pictures; None as `relative_pose`."""
    return refined_pose(T_to_from, track_warped(first, second, rig, T_to_from), rig)


def _predicted(uv: Float32, d: Float64, rig: StereoRig, T_to_from: Float64) -> Float32:
    """(N, 2) where the points should be after the motion; where they were if that is far off."""
    points = points_by_q(d, uv[:, 0].astype(np.float64), uv[:, 1].astype(np.float64), rig)
    there, depth_m = project(points @ T_to_from[:3, :3].T + T_to_from[:3, 3], rig.P_left)
    near = np.abs(there - uv).max(axis=1) < MAX_PREDICTED_SHIFT_PX
    return np.where((near & (depth_m > NEAREST_M))[:, None], there, uv).astype(np.float32)


def _tracks(
    uv: Float32, d: Float64, there: Float32 | Float64, d_there: Float64, good: Bool
) -> PointTracks:
    columns = (uv, d, there, d_there)
    return PointTracks(*(np.asarray(column[good], np.float64) for column in columns))
