"""Disparities carried from one frame into the next, and made one with what that measured."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def carry(
    fused: AnyArray, counts: AnyArray, camera: AnyArray, T: AnyArray, out: AnyArray, seen: AnyArray
) -> None:
    """Each pixel of a frame put where the next camera sees it; the nearest of several wins.

    Args:
        fused: (2, H, W) float32: true disparity (f B / Z), px, NaN where there is none; variance.
        counts: (H, W) uint16 frames that agree.
        camera: (6,) float32: fx, fy, cx, cy px, f B px m, nearest depth m.
        T: (3, 4) float32 maps points of the camera to the next one.
        out: (4, H, W) float32 out: disparity, variance, and how far the point lies right of and
            below the middle of its pixel; disparity NaN where nothing is carried.
        seen: (H, W) uint16 out: counts.
    """
    fx, fy, cx, cy, fB, nearest = camera
    height, width = counts.shape
    out[0, :, :] = np.nan
    for v in range(height):
        y = (v - cy) / fy
        for u in range(width):
            d = fused[0, v, u]
            if not d > 0:
                continue
            z = fB / d
            x = (u - cx) / fx
            there_z = (T[2, 0] * x + T[2, 1] * y + T[2, 2]) * z + T[2, 3]
            if there_z < nearest:
                continue
            there_x = (T[0, 0] * x + T[0, 1] * y + T[0, 2]) * z + T[0, 3]
            there_y = (T[1, 0] * x + T[1, 1] * y + T[1, 2]) * z + T[1, 3]
            there_u = fx * there_x / there_z + cx
            there_v = fy * there_y / there_z + cy
            column, row = math.floor(there_u + 0.5), math.floor(there_v + 0.5)
            if not (0 <= column < width and 0 <= row < height):
                continue
            there_d = fB / there_z
            if out[0, row, column] >= there_d:
                continue
            grown = there_d / d
            out[0, row, column] = there_d
            # Sigma of the depth stays: that of the disparity grows with its square.
            out[1, row, column] = fused[1, v, u] * grown * grown * grown * grown
            out[2, row, column] = there_u - column
            out[3, row, column] = there_v - row
            seen[row, column] = counts[v, u]


@_kernel
def join(
    carried: AnyArray,
    seen: AnyArray,
    measured: AnyArray,
    limits: AnyArray,
    fused: AnyArray,
    counts: AnyArray,
) -> None:
    """What was carried and what was measured as one, where they agree; else what was measured.

    Args:
        carried: (4, H, W) as `carry` made it.
        seen: (H, W) uint16 counts of it.
        measured: (2, H, W) float32: true disparity, px, NaN where there is none; variance.
        limits: (5,) float32: variance that carrying adds, px^2; gate in standard deviations, and
            variance added to theirs in it, px^2; share of the variance that averaging does not
            lower; steepest slope that a surface is carried along, px a px.
        fused: (2, H, W) float32 out.
        counts: (H, W) uint16 out.
    """
    drift, gate, margin, common, steepest = limits
    height, width = seen.shape
    disparity = measured[0]
    for v in range(height):
        for u in range(width):
            m, r = disparity[v, u], measured[1, v, u]
            fused[0, v, u], fused[1, v, u], counts[v, u] = m, r, 1
            d = carried[0, v, u]
            if not (m > 0 and d > 0):
                counts[v, u] = 0 if not m > 0 else 1
                continue
            right = _slope(disparity, v, u, 0, 1, steepest)
            down = _slope(disparity, v, u, 1, 0, steepest)
            # What was carried lies beside the middle of the pixel: along the surface to it.
            d -= right * carried[2, v, u] + down * carried[3, v, u]
            variance = carried[1, v, u] + drift
            if (m - d) ** 2 > gate * gate * (variance + r + margin):
                continue
            gain = variance / (variance + r)
            fused[0, v, u] = d + gain * (m - d)
            # Errors of one surface are alike from frame to frame: some of them stay.
            fused[1, v, u] = max((1 - gain) * variance, common * r)
            counts[v, u] = min(seen[v, u] + 1, 65535)


@_kernel
def _slope(d: AnyArray, v: int, u: int, down: int, right: int, steepest: float) -> float:
    """Slope of a surface at a pixel, px a px; 0 where it is none."""
    height, width = d.shape
    if not (down <= v < height - down and right <= u < width - right):
        return np.float32(0)
    before, after = d[v - down, u - right], d[v + down, u + right]
    slope = np.float32(0.5) * (after - before)
    here = d[v, u]
    bent = abs(after - here - here + before)
    if abs(slope) < steepest and bent < steepest:
        return slope
    return np.float32(0)


@_kernel
def surface(
    fused: AnyArray, camera: AnyArray, limits: AnyArray, normals: AnyArray, fine: AnyArray
) -> None:
    """Normals of the pixels that lie on a surface.

    Args:
        fused: (2, H, W) float32 true disparity, px, and variance.
        camera: (6,) as for `carry`.
        limits: (2,) float32: pixels to either side that a slope is taken over; largest bend, px.
        normals: (3, H, W) float32 out, towards the camera.
        fine: (H, W) bool out: whether a pixel lies on a surface that is smooth around it.
    """
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    step, most_bent = int(limits[0]), limits[1]
    height, width = fine.shape
    fine[:, :] = False
    for v in range(step, height - step):
        for u in range(step, width - step):
            d = fused[0, v, u]
            left, right = fused[0, v, u - step], fused[0, v, u + step]
            above, below = fused[0, v - step, u], fused[0, v + step, u]
            if not (d > 0 and left > 0 and right > 0 and above > 0 and below > 0):
                continue
            if abs(left - 2 * d + right) > most_bent or abs(above - 2 * d + below) > most_bent:
                continue
            a, b = (right - left) / (2 * step), (below - above) / (2 * step)
            # The plane d = a (u - u0) + b (v - v0) + c in space.
            nx, ny = a * fx, b * fy
            nz = a * (cx - u) + b * (cy - v) + d
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if not length > 0:
                continue
            # Towards the camera: against the line of sight.
            towards = nx * (u - cx) / fx + ny * (v - cy) / fy + nz
            sign = -1.0 if towards > 0 else 1.0
            normals[0, v, u] = sign * nx / length
            normals[1, v, u] = sign * ny / length
            normals[2, v, u] = sign * nz / length
            fine[v, u] = True
