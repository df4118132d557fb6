"""Rays through blocks of voxels: what they end in, and what they pass."""

from __future__ import annotations

import math

from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Voxels along each side of a block, as a power of two.
BITS = 4
BLOCK = 1 << BITS
_WITHIN = BLOCK - 1
# Rays that carve: every so many; neighbours pass the same voxels, and each counts once a view.
CARVE_EVERY = 4
# A ray says nothing about voxels nearer to its end than so many sigmas and one voxel.
UNSURE_SIGMAS = 2.0
# A point counts at least so much where it lies, however unsure: errors of one surface are alike
# from view to view, and walls at 20 m would never be taken (street, 8 frames, 2026-11-27).
LEAST_SHARE = 0.25

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def mark_blocks(
    points: AnyArray,
    origin: AnyArray,
    block_m: float,
    far_m: float,
    first: AnyArray,
    used: AnyArray,
) -> None:
    """Mark the blocks of a window that rays pass or end in.

    Args:
        points: (N, 3) float64 m.
        origin: (3,) where the rays start.
        block_m: side of a block.
        far_m: rays are followed so far.
        first: (3,) int64 block coordinates of the window's first corner.
        used: (X, Y, Z) uint8 out.
    """
    for n in range(len(points)):
        dx, dy, dz = points[n, 0] - origin[0], points[n, 1] - origin[1], points[n, 2] - origin[2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        reach = min(length, far_m)
        steps = math.ceil(reach / (0.25 * block_m)) + 1
        start = steps if n % CARVE_EVERY else 0
        for step in range(start, steps + 1):
            s = reach * step / steps / length if length > 0 else 0.0
            i = math.floor((origin[0] + s * dx) / block_m) - first[0]
            j = math.floor((origin[1] + s * dy) / block_m) - first[1]
            k = math.floor((origin[2] + s * dz) / block_m) - first[2]
            if 0 <= i < used.shape[0] and 0 <= j < used.shape[1] and 0 <= k < used.shape[2]:
                used[i, j, k] = 1


@_kernel
def trace(
    points: AnyArray,
    sigma: AnyArray,
    origin: AnyArray,
    voxel_m: float,
    far_m: float,
    first: AnyArray,
    rows: AnyArray,
    hit: AnyArray,
    height: AnyArray,
    passed: AnyArray,
) -> None:
    """What a view says of the voxels around it.

    Args:
        points: (N, 3) float64 m, ends of the rays.
        sigma: (N,) one standard deviation along the ray, m.
        origin: (3,) where they start.
        voxel_m: side of a voxel.
        far_m: points beyond are not held, and their rays carve up to there.
        first: (3,) int64 block coordinates of the window's first corner.
        rows: (X, Y, Z) int32 row of each block in the following arrays, -1 for none.
        hit: (B, 16, 16, 16) float32 in and out: largest share of an end that lies in the voxel.
        height: (B, 16, 16, 16) float32 in and out: z of that end.
        passed: (B, 16, 16, 16) uint8 in and out: a ray went through.
    """
    for n in range(len(points)):
        dx, dy, dz = points[n, 0] - origin[0], points[n, 1] - origin[1], points[n, 2] - origin[2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if not length > voxel_m:
            continue
        if length <= far_m:
            # Share of a normal error that is within half a voxel.
            share = math.erf(voxel_m / (2.0 * math.sqrt(2.0) * max(sigma[n], 1e-6)))
            share = max(share, LEAST_SHARE)
            i = math.floor(points[n, 0] / voxel_m)
            j = math.floor(points[n, 1] / voxel_m)
            k = math.floor(points[n, 2] / voxel_m)
            row = _row(rows, first, i, j, k)
            if row >= 0 and share > hit[row, i & _WITHIN, j & _WITHIN, k & _WITHIN]:
                hit[row, i & _WITHIN, j & _WITHIN, k & _WITHIN] = share
                height[row, i & _WITHIN, j & _WITHIN, k & _WITHIN] = points[n, 2]
        if n % CARVE_EVERY:
            continue
        end = min(length - UNSURE_SIGMAS * sigma[n] - voxel_m, far_m)
        step = 0.7 * voxel_m
        for number in range(math.floor(max(end, 0.0) / step)):
            s = number * step / length
            i = math.floor((origin[0] + s * dx) / voxel_m)
            j = math.floor((origin[1] + s * dy) / voxel_m)
            k = math.floor((origin[2] + s * dz) / voxel_m)
            row = _row(rows, first, i, j, k)
            if row >= 0:
                passed[row, i & _WITHIN, j & _WITHIN, k & _WITHIN] = 1


@_kernel
def _row(rows: AnyArray, first: AnyArray, i: int, j: int, k: int) -> int:
    """Row of a voxel's block; -1 where it has none."""
    x, y, z = (i >> BITS) - first[0], (j >> BITS) - first[1], (k >> BITS) - first[2]
    if 0 <= x < rows.shape[0] and 0 <= y < rows.shape[1] and 0 <= z < rows.shape[2]:
        return rows[x, y, z]
    return -1
