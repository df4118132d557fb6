"""Whether two places are one: by the pose that their points agree on, and by their depths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.geometry.pnp import RelativePose, first_pose, refined_pose
from pseudolidar.geometry.projection import project
from pseudolidar.geometry.triangulation import points_by_q
from pseudolidar.geometry.twists import inverted, log_twist
from pseudolidar.mapping.place import CELL_PX, Place, cell_centres
from pseudolidar.mapping.words import nearest
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.loop import LoopClosure
from pseudolidar.structures.point_tracks import PointTracks

# Descriptors are alike when they differ in fewer bits, and the next best one in more by a factor.
ALIKE_BITS, DISTINCT = 64, 0.85
# Error of a point that ORB finds again, px, and within what RANSAC takes it for the same.
ORB_SIGMA_PX, RANSAC_PX = 0.8, 2.5
# A pose needs so many points that agree, and this share of all that are alike.
LEAST_INLIERS, LEAST_SHARE = 30, 0.4
# They must lie in so many of the picture's 4 x 2 parts.
LEAST_PARTS = 4
# Poses found from either side must be one, m and degrees.
MOST_APART_M, MOST_APART_DEG = 0.3, 1.0
# Places farther from each other see it too differently, m.
FARTHEST_M = 15.0
# Depths agree within so many sigma of a disparity of this error, px, or this share.
DEPTH_SIGMAS, DEPTH_SIGMA_PX, DEPTH_SHARE = 3.0, 0.5, 0.08
# Share of what both could see that must agree, and how many cells must be compared.
LEAST_OVERLAP, LEAST_CELLS = 0.8, 40
# The grey of the cells that agree must be alike: correlation.
LEAST_LIKENESS = 0.86
# Points on one plane tell no place, as one road looks like another: so many, and this share, must
# lie farther off it, m, or by this share of their depth; and in so many of the picture's columns,
# as one car looks like another.
LEAST_OFF_PLANE, LEAST_OFF_SHARE = 12, 0.3
COLUMNS, LEAST_COLUMNS = 8, 4
PLANE_TRIES, PLANE_M, PLANE_SHARE, LEAST_TRIPLE_M2 = 100, 0.2, 0.02, 1e-3
# Errors of matched points are not independent: poses err more, in variance.
ALIKE = 6.0

Refusal = Literal[
    "few_matches", "no_pose", "few_inliers", "one_sided", "one_plane", "far_apart", "both_ways",
    "overlap", "unlike", "drift", "unconfirmed",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Alike:
    """Points of two places whose descriptors are alike."""

    tracks: PointTracks

    @classmethod
    def of(cls, earlier: Place, later: Place) -> Alike:
        """Mutually nearest descriptors that are near and distinct."""
        if min(len(earlier), len(later)) < 2:
            return cls(PointTracks(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)), np.zeros(0)))
        bits, row = nearest(earlier.descriptors, later.descriptors, 2)
        _, back = nearest(later.descriptors, earlier.descriptors)
        good = (bits[:, 0] < ALIKE_BITS) & (bits[:, 0] < DISTINCT * bits[:, 1])
        good &= back[row[:, 0], 0] == np.arange(len(earlier))
        a, b = np.flatnonzero(good), row[good, 0]
        columns = (earlier.uv[a], earlier.d[a], later.uv[b], later.d[b])
        return cls(PointTracks(*(np.asarray(column, np.float64) for column in columns)))


def verified(earlier: Place, later: Place, rig: StereoRig) -> LoopClosure | Refusal:
    """The loop between two places, or why there is none.

    Args:
        earlier: seen first.
        later: seen again.
        rig: of both, without correction: their disparities are corrected.
    """
    tracks = Alike.of(earlier, later).tracks
    if len(tracks) < LEAST_INLIERS:
        return "few_matches"
    back = _pose(tracks, rig)
    there = _pose(_turned(tracks), rig)
    if back is None or there is None:
        return "no_pose"
    agree = back.weights >= 0.25
    if agree.sum() < max(LEAST_INLIERS, LEAST_SHARE * len(tracks)):
        return "few_inliers"
    inliers = tracks[agree]
    if min(_parts(uv, rig) for uv in (inliers.uv_from, inliers.uv_to)) < LEAST_PARTS:
        return "one_sided"
    standing = inliers[_off_plane(_points(inliers, rig))]
    if len(standing) < max(LEAST_OFF_PLANE, LEAST_OFF_SHARE * len(inliers)):
        return "one_plane"
    if min(_columns(uv, rig) for uv in (standing.uv_from, standing.uv_to)) < LEAST_COLUMNS:
        return "one_plane"
    if back.distance_m > FARTHEST_M:
        return "far_apart"
    apart = log_twist(back.T_to_from @ there.T_to_from)
    apart_m, apart_deg = _sizes(apart)
    if apart_m > MOST_APART_M or apart_deg > MOST_APART_DEG:
        return "both_ways"
    T_later_earlier = back.T_to_from
    seen = (
        _seen(earlier, later, T_later_earlier, rig),
        _seen(later, earlier, inverted(T_later_earlier), rig),
    )
    if min(one.compared for one in seen) < LEAST_CELLS:
        return "overlap"
    overlap = min(one.share for one in seen)
    likeness = min(one.likeness for one in seen)
    if overlap < LEAST_OVERLAP:
        return "overlap"
    if not likeness > LEAST_LIKENESS:
        return "unlike"
    T_earlier_later = inverted(T_later_earlier)
    return LoopClosure(
        earlier.end,
        later.end,
        T_earlier_later,
        np.asarray(np.linalg.inv(back.information) * ALIKE, np.float64),
        inliers.uv_from.astype(np.float32),
        inliers.uv_to.astype(np.float32),
        _residuals_px(inliers, T_later_earlier, rig),
        len(tracks),
        overlap,
        apart_m,
        apart_deg,
        *_correction(earlier, later, T_earlier_later),
    )


def _pose(tracks: PointTracks, rig: StereoRig) -> RelativePose | None:
    rough = first_pose(tracks, rig, within_px=RANSAC_PX)
    return None if rough is None else refined_pose(rough, tracks, rig, sigma_px=ORB_SIGMA_PX)


def _turned(tracks: PointTracks) -> PointTracks:
    return PointTracks(tracks.uv_to, tracks.d_to, tracks.uv_from, tracks.d_from)


def _parts(uv: Float64, rig: StereoRig) -> int:
    """How many of the 4 x 2 parts of the picture hold points."""
    width, height = rig.left.size_px
    part = np.floor(uv / (width / 4, height / 2)).astype(np.int64)
    return len(np.unique(part, axis=0))


def _sizes(twist: Float64) -> tuple[float, float]:
    """Metres and degrees of a twist."""
    return float(np.linalg.norm(twist[:3])), float(np.rad2deg(np.linalg.norm(twist[3:])))


def _points(tracks: PointTracks, rig: StereoRig) -> Float64:
    """(N, 3) m in the earlier camera."""
    return points_by_q(tracks.d_from, tracks.uv_from[:, 0], tracks.uv_from[:, 1], rig)


def _columns(uv: Float64, rig: StereoRig) -> int:
    """In how many of the picture's 8 columns there are points."""
    return len(np.unique(np.floor(uv[:, 0] / (rig.left.size_px[0] / COLUMNS))))


def _off_plane(xyz: Float64) -> Bool:
    """(N,) which points (N, 3) m lie off the plane that most of them lie on."""
    triples = np.random.default_rng(0).integers(0, len(xyz), (PLANE_TRIES, 3))
    a, b, c = np.moveaxis(xyz[triples], 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    made = length > LEAST_TRIPLE_M2  # no plane is told by points on one line
    if not made.any():
        return np.zeros(len(xyz), np.bool_)
    a, normals = a[made], normals[made] / length[made, None]
    off_m = np.abs(normals @ xyz.T - np.sum(normals * a, axis=1)[:, None])
    off = off_m > np.maximum(PLANE_M, PLANE_SHARE * xyz[:, 2])
    return np.asarray(off[off.sum(axis=1).argmin()])


def _residuals_px(tracks: PointTracks, T: Float64, rig: StereoRig) -> Float64:
    uv, _ = project(_points(tracks, rig) @ T[:3, :3].T + T[:3, 3], rig.P_left)
    return np.asarray(np.linalg.norm(uv - tracks.uv_to, axis=1))


def _correction(earlier: Place, later: Place, T_earlier_later: Float64) -> tuple[float, float]:
    """How far odometry disagrees, m and degrees; NaN between pieces."""
    if earlier.end.piece != later.end.piece:
        return float("nan"), float("nan")
    by_odometry = inverted(earlier.T_odom_camera) @ later.T_odom_camera
    apart = inverted(by_odometry) @ T_earlier_later
    return float(np.linalg.norm(apart[:3, 3])), _sizes(log_twist(apart))[1]


@dataclass(frozen=True)
class _Seen:
    """What one place shows of the other.

    Args:
        compared: cells that both could see.
        share: of them, whose depths agree.
        likeness: correlation of the grey of those, -1 to 1.
    """

    compared: int
    share: float
    likeness: float


def _seen(one: Place, other: Place, T_other_one: Float64, rig: StereoRig) -> _Seen:
    """Cells of one place laid on those of the other.

    Cells behind what the other place saw are hidden there and say nothing.
    """
    cells = one.depth_cells_m.astype(np.float64)
    (height, width), (u, v) = cells.shape, cell_centres(cells.shape)
    known = np.isfinite(cells)
    K, z = rig.left.K, cells[known]
    x, y = (u[known] - K[0, 2]) / K[0, 0] * z, (v[known] - K[1, 2]) / K[1, 1] * z
    xyz = np.column_stack([x, y, z]) @ T_other_one[:3, :3].T + T_other_one[:3, 3]
    uv, depth = project(xyz, rig.P_left)
    column, row = np.floor((np.nan_to_num(uv, nan=-1.0) + 0.5) / CELL_PX).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (row < height) & (column < width)
    row, column, depth = row[inside], column[inside], depth[inside]
    there = other.depth_cells_m[row, column].astype(np.float64)
    within = DEPTH_SIGMAS * DEPTH_SIGMA_PX * there**2 / rig.fB_px_m + DEPTH_SHARE * there
    agree, seen = np.abs(depth - there) < within, depth < there + within  # NaN are neither
    if agree.sum() < LEAST_CELLS:
        return _Seen(int(seen.sum()), 0.0, 0.0)
    grey = one.grey_cells[known][inside][agree], other.grey_cells[row, column][agree]
    likeness = float(np.corrcoef(*(values.astype(np.float64) for values in grey))[0, 1])
    return _Seen(int(seen.sum()), float(agree.sum() / seen.sum()), likeness)


def consistent(one: LoopClosure, other: LoopClosure, T_one: Float64, T_other: Float64) -> Float64:
    """(6,) twist by which two loops disagree about the pose of one's later frame.

    Args:
        one: loop.
        other: loop nearby.
        T_one: (4, 4) odometry from the earlier end of `one` to that of `other`.
        T_other: (4, 4) the same of their later ends.
    """
    by_other = T_one @ other.T_earlier_later @ inverted(T_other)
    return log_twist(inverted(one.T_earlier_later) @ by_other)
