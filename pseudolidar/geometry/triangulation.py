"""Disparity to depth and points, by Q and by P, for one rectified rig; plain numpy."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig


def forward_offset_m(rig: StereoRig) -> float:
    """How far the right centre lies behind the left one along the optical axis (KITTI: 0.02 mm)."""
    return float(rig.P_right[2, 3])


def ideal_disparity(d: Float64, u: Float64, rig: StereoRig) -> Float64:
    """Disparity that the pair would measure if both centres had the same depth, as Q assumes.

    d_ideal + doffs = (d + doffs) / (1 + (u - d) tz / (f B)), from the exact depth
    Z = (f B + u_right tz) / (d + doffs) with tz = P_right[2, 3].

    Args:
        d: measured disparities, px, any shape.
        u: columns of the left image, px, broadcastable to `d`.
        rig: rectified rig.

    Returns:
        Disparities of the ideal pair, px, shape of `d`.
    """
    stretch = 1.0 + (u - d) * forward_offset_m(rig) / rig.fB_px_m
    return np.asarray((d + rig.doffs_px) / stretch - rig.doffs_px)


def depth_from_disparity(d: Float64, u: Float64, rig: StereoRig) -> Float64:
    """Depth Z, m, of disparities `d` at columns `u`; NaN where the disparity has none.

    Does not apply the rig's correction: `corrected_disparity` does.
    """
    above_infinity = d + rig.doffs_px
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = (rig.fB_px_m + (u - d) * forward_offset_m(rig)) / above_infinity
    return np.where(above_infinity > 0, depth_m, np.nan)


def disparity_from_depth(depth_m: Float64, u: Float64, rig: StereoRig) -> Float64:
    """Disparity, px, at which a surface at depth Z (m) and column `u` appears; exact inverse."""
    tz = forward_offset_m(rig)
    return np.asarray((rig.fB_px_m + u * tz - rig.doffs_px * depth_m) / (depth_m + tz))


def depth_per_disparity(d: Float64, depth_m: Float64, rig: StereoRig) -> Float64:
    """|dZ / dd|, m per px: the depth error that one pixel of disparity error makes."""
    return np.asarray((depth_m + forward_offset_m(rig)) / (d + rig.doffs_px))


def corrected_disparity(d: Float64, u: Float64, v: Float64, rig: StereoRig) -> Float64:
    """Disparities without the systematic error that the rig is known to have.

    Args:
        d: (N,) measured, px.
        u: (N,) column, px.
        v: (N,) row, px.
        rig: with its correction, or none.

    Returns:
        (N,) px; at or below `-doffs_px` for what lies beyond infinity.
    """
    if rig.correction is None:
        return d
    return d - rig.correction.offset_px(d, u, v, rig.left.size_px)


def measured_disparity(d: Float64, u: Float64, v: Float64, rig: StereoRig) -> Float64:
    """Disparities that the rig would measure of true ones: the inverse of `corrected_disparity`.

    The correction is linear in the disparity: offset = a(u, v) + b d.

    Args:
        d: true, px, any shape.
        u: column, px, of the same shape.
        v: row, px, of the same shape.
        rig: with its correction, or none.
    """
    if rig.correction is None:
        return d
    size, zero = rig.left.size_px, np.zeros_like(d)
    at_zero = rig.correction.offset_px(zero, u, v, size)
    return np.asarray((d + at_zero) / (1 - rig.correction.per_px))


def points_by_q(d: Float64, u: Float64, v: Float64, rig: StereoRig) -> Float64:
    """(N, 3) points in the left camera's frame, m: `Q (u, v, d, 1)` of the ideal disparity.

    Source: OpenCV reprojectImageTo3D, with d = x_left - x_right positive.
    """
    x, y, z, w = rig.Q @ np.stack([u, v, ideal_disparity(d, u, rig), np.ones_like(d)])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((w > 0)[:, None], np.stack([x, y, z], axis=1) / w[:, None], np.nan)


def points_by_p(d: Float64, u: Float64, v: Float64, rig: StereoRig) -> Float64:
    """(N, 3) points in the left camera's frame, m, from the three projection equations.

    The pixel (u, v) of the left and the column u - d of the right image give three linear
    equations in (X, Y, Z), solved by Cramer's rule.

    Source: Hartley & Zisserman, Multiple View Geometry, 2nd ed., section 12.2.
    """
    left, right = rig.P_left, rig.P_right
    a, a_e = _equation(left[0], left[2], u)
    b, b_e = _equation(left[1], left[2], v)
    c, c_e = _equation(right[0], right[2], u - d)
    bc, ca, ab = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    determinant = np.sum(a * bc, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = (a_e * bc + b_e * ca + c_e * ab) / determinant
    return np.where((d + rig.doffs_px > 0)[:, None], points, np.nan)


def _equation(row: Float64, depth_row: Float64, coordinate: Float64) -> tuple[Float64, Float64]:
    """`n . X = e` of one image coordinate (N,), as n (N, 3) and e (N, 1)."""
    equation = row - coordinate[:, None] * depth_row
    return equation[:, :3], -equation[:, 3:]
