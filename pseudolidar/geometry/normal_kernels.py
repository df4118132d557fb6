"""Planes through neighbours: in the image, and in space."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Every second neighbour of 13x13: as accurate as all of them at a quarter of the work, for errors
# of matching are alike next door.
RADIUS, STRIDE_PX = 3, 2
REACH_PX = RADIUS * STRIDE_PX
LEAST_PIXELS = 24  # of 49
# Neighbours of one surface differ in inverse depth by at most this share for each pixel apart: a
# road seen at 1 in 30 differs by 0.02.
STEP_SHARE = 0.03
# A plane needs points across: the second largest variance, as a share of the largest.
LEAST_WIDTH = 1e-4
JACOBI_SWEEPS = 8

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def plane_gradients(padded: AnyArray, out: AnyArray) -> None:
    """Plane through the inverse depths of each pixel's neighbours of the same surface.

    Args:
        padded: (H + 2 REACH_PX, W + 2 REACH_PX) float32 1/m, 0 where there is none.
        out: (3, H, W) float32 out: slope along u, along v, value at the pixel; NaN without plane.
    """
    _, height, width = out.shape
    sums = np.empty((9, width), np.float32)
    one, zero = np.float32(1), np.float32(0)
    for y in range(height):
        centre = padded[y + REACH_PX, REACH_PX : REACH_PX + width]
        sums[:] = zero
        n, sx, sy, sxx, sxy = sums[0], sums[1], sums[2], sums[3], sums[4]
        syy, s, sxd, syd = sums[5], sums[6], sums[7], sums[8]
        for j in range(-RADIUS, RADIUS + 1):
            for i in range(-RADIUS, RADIUS + 1):
                start = REACH_PX + STRIDE_PX * i
                row = padded[y + REACH_PX + STRIDE_PX * j, start : start + width]
                share = np.float32(STEP_SHARE * STRIDE_PX * max(abs(i), abs(j), 1))
                di, dj = np.float32(i), np.float32(j)
                for x in range(width):
                    d = row[x] - centre[x]
                    w = one if (row[x] > zero) & (abs(d) <= share * centre[x]) else zero
                    d *= w
                    n[x] += w
                    sx[x] += w * di
                    sy[x] += w * dj
                    s[x] += d
                    sxd[x] += di * d
                    syd[x] += dj * d
                for x in range(width):
                    d = row[x] - centre[x]
                    w = one if (row[x] > zero) & (abs(d) <= share * centre[x]) else zero
                    sxx[x] += w * di * di
                    sxy[x] += w * di * dj
                    syy[x] += w * dj * dj
        for x in range(width):
            out[0, y, x] = out[1, y, x] = out[2, y, x] = np.nan
            if not (centre[x] > 0 and n[x] >= LEAST_PIXELS):
                continue
            cxx = sxx[x] - sx[x] * sx[x] / n[x]
            cxy = sxy[x] - sx[x] * sy[x] / n[x]
            cyy = syy[x] - sy[x] * sy[x] / n[x]
            cxd, cyd = sxd[x] - sx[x] * s[x] / n[x], syd[x] - sy[x] * s[x] / n[x]
            determinant = cxx * cyy - cxy * cxy
            if not determinant > np.float32(0.05) * cxx * cyy:
                continue
            a = (cxd * cyy - cyd * cxy) / determinant
            b = (cyd * cxx - cxd * cxy) / determinant
            out[0, y, x], out[1, y, x] = a / STRIDE_PX, b / STRIDE_PX
            out[2, y, x] = centre[x] + (s[x] - a * sx[x] - b * sy[x]) / n[x]


@_kernel
def _rotate(m: AnyArray, v: AnyArray, p: int, q: int) -> None:
    """One Jacobi rotation: m[p, q] becomes 0."""
    if m[p, q] == 0:
        return
    theta = (m[q, q] - m[p, p]) / (2 * m[p, q])
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1))
    c = 1 / math.sqrt(t * t + 1)
    s = t * c
    for k in range(3):
        a, b = m[k, p], m[k, q]
        m[k, p], m[k, q] = c * a - s * b, s * a + c * b
    for k in range(3):
        a, b = m[p, k], m[q, k]
        m[p, k], m[q, k] = c * a - s * b, s * a + c * b
    for k in range(3):
        a, b = v[k, p], v[k, q]
        v[k, p], v[k, q] = c * a - s * b, s * a + c * b


@_kernel
def plane_normals(points: AnyArray, near: AnyArray, origin: AnyArray, out: AnyArray) -> None:
    """Direction of least variance of each point's neighbours, towards `origin`.

    Args:
        points: (N, 3) float64 m.
        near: (N, K) int64 positions of the neighbours.
        origin: (3,) m.
        out: (N, 3) float32 out; NaN where the neighbours lie on a line.
    """
    count, k = near.shape
    m, v = np.empty((3, 3)), np.empty((3, 3))
    mean = np.empty(3)
    for i in range(count):
        mean[:] = 0.0
        for j in range(k):
            for a in range(3):
                mean[a] += points[near[i, j], a] / k
        m[:] = 0.0
        for j in range(k):
            for a in range(3):
                for b in range(3):
                    m[a, b] += (points[near[i, j], a] - mean[a]) * (points[near[i, j], b] - mean[b])
        v[:] = 0.0
        for a in range(3):
            v[a, a] = 1.0
        for _ in range(JACOBI_SWEEPS):
            _rotate(m, v, 0, 1)
            _rotate(m, v, 0, 2)
            _rotate(m, v, 1, 2)
        least = 0
        for a in range(1, 3):
            if m[a, a] < m[least, least]:
                least = a
        largest = max(m[0, 0], m[1, 1], m[2, 2])
        middle = m[0, 0] + m[1, 1] + m[2, 2] - largest - m[least, least]
        if not middle > LEAST_WIDTH * largest:
            out[i, :] = np.nan
            continue
        side = 0.0
        for a in range(3):
            side += v[a, least] * (origin[a] - points[i, a])
        sign = 1.0 if side >= 0 else -1.0
        for a in range(3):
            out[i, a] = sign * v[a, least]
