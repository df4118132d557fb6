"""What a hole of a disparity map is surrounded by, and what that makes of it."""

from __future__ import annotations

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Directions of the rim, counter-clockwise from the right; the first four are done going up.
COLUMN_STEP = (1, 1, 0, -1, -1, -1, 0, 1)
ROW_STEP = (0, -1, -1, -1, 0, 1, 1, 1)
EAST, NORTH_EAST, NORTH, NORTH_WEST, WEST, SOUTH_WEST, SOUTH, SOUTH_EAST = range(8)
# A second look at the rim so much farther along tells its slope from a step, px.
SECOND_LOOK_PX = 4
# Looks (of at most 16) and second looks that a plane needs.
LEAST_LOOKS, LEAST_SECOND_LOOKS = 9, 3
NONE, SURFACE, OCCLUSION = np.uint8(0), np.uint8(1), np.uint8(2)
# How far looks may lie off the plane they are to share: px, or as a share of the disparity.
OFF_PLANE_PX, OFF_PLANE_SHARE = 0.6, 0.03
STEEPEST = 1.0  # px a pixel
# A step to the right that hides something, and how much wider than the step its shadow may be.
STEP_PX, STEP_SHARE = 2.0, 0.1
SHADOW_SHARE, SHADOW_PX = 1.25, 4.0
# A hole of another colour than its whole rim is another thing, seen through it: grey levels.
OTHER_COLOUR = 20.0
# An unsure rim is no ground to stand on: mean sigma, px.
UNSURE_PX = 1.5
# Share of D1 outliers among filled pixels without these two and with them, KITTI stereo 2015:
# planes 8.4 and 4.3 % (the row's minimum there: 4.8 %), shadows 25 and 15 % (checked besides by
# what must hide them). Middlebury's motorcycle, seen through spokes: 55 and 34 %, 23 and 12 %.

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def rim_distances(valid: AnyArray, largest: int, out: AnyArray) -> None:
    """Steps to the nearest valid pixel in each of eight directions; 0 where there is none.

    Args:
        valid: (H, W) bool.
        largest: longer ways count as none.
        out: (8, H, W) int16 out.
    """
    height, width = valid.shape
    for order in range(2):
        for i in range(height):
            y = i if order == 0 else height - 1 - i
            for j in range(width):
                x = j if order == 0 else width - 1 - j
                for k in range(4):
                    direction = (k + 1 if order == 0 else k + 5) % 8
                    v, u = y + ROW_STEP[direction], x + COLUMN_STEP[direction]
                    steps = 0
                    if 0 <= v < height and 0 <= u < width:
                        if valid[v, u]:
                            steps = 1
                        elif 0 < out[direction, v, u] < largest:
                            steps = out[direction, v, u] + 1
                    out[direction, y, x] = steps


@_kernel
def _solve3(m: AnyArray, r: AnyArray, plane: AnyArray) -> bool:
    """Solve the symmetric 3x3 system; False where it is singular."""
    a, b, c, d, e, f = m[0], m[1], m[2], m[3], m[4], m[5]
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * c00 + b * c01 + c * c02
    if not determinant > 1e-6:
        return False
    plane[0] = (c00 * r[0] + c01 * r[1] + c02 * r[2]) / determinant
    plane[1] = (c01 * r[0] + (a * f - c * c) * r[1] + (b * c - a * e) * r[2]) / determinant
    plane[2] = (c02 * r[0] + (b * c - a * e) * r[1] + (a * d - b * b) * r[2]) / determinant
    return True


@_kernel
def _difference(picture: AnyArray, y: int, x: int, v: int, u: int) -> float:
    """Distance of the colours of two pixels, grey levels."""
    total = np.int32(0)
    for c in range(picture.shape[2]):
        step = np.int32(picture[y, x, c]) - np.int32(picture[v, u, c])
        total += step * step
    return np.sqrt(total)


@_kernel
def fill(
    values: AnyArray,
    sigma: AnyArray,
    picture: AnyArray,
    distances: AnyArray,
    largest_px: int,
    largest_m: float,
    nearest_px: float,
    baseline_m: float,
    doffs_px: float,
    out: AnyArray,
    kind: AnyArray,
    rim_sigma: AnyArray,
    off_plane: AnyArray,
    away: AnyArray,
) -> None:
    """Decide for every hole pixel what it is and which disparity it takes.

    Args:
        values: (H, W) float32 px, NaN = hole.
        sigma: (H, W) float32 px.
        picture: (H, W, C) uint8.
        distances: of `rim_distances`.
        largest_px: wider holes stay.
        largest_m: wider holes stay, at the depth of what would fill them.
        nearest_px: smaller disparities (and `doffs_px`) are too far away: the sky is.
        baseline_m: of the rig.
        doffs_px: of the rig.
        out: (H, W) float32 out: disparity, only where `kind` is set.
        kind: (H, W) uint8 out: NONE, SURFACE or OCCLUSION.
        rim_sigma: (H, W) float32 out: mean sigma of the rim that is used.
        off_plane: (H, W) float32 out: rms of the rim off its plane; px.
        away: (H, W) float32 out: steps to the nearest pixel of it.
    """
    height, width = values.shape
    du, dv = np.empty(16, np.float64), np.empty(16, np.float64)
    d = np.empty(16, np.float64)
    moments, right = np.empty(6, np.float64), np.empty(3, np.float64)
    plane = np.empty(3, np.float64)
    for y in range(height):
        for x in range(width):
            kind[y, x] = NONE
            if not np.isnan(values[y, x]):
                continue
            west, east = distances[WEST, y, x], distances[EAST, y, x]
            if west == 0 or east == 0 or west + east - 1 > largest_px:
                continue
            run = west + east - 1
            behind, front = values[y, x - west], values[y, x + east]
            above_infinity = min(behind, front) + doffs_px
            if not (above_infinity > 0 and above_infinity >= nearest_px):
                continue
            if run * baseline_m / above_infinity > largest_m:
                continue
            # A plane through all of the rim?
            looks = seconds = 0
            total_sigma = 0.0
            nearest = 32767
            likest = 1e9
            tolerance = max(OFF_PLANE_PX, OFF_PLANE_SHARE * behind)
            for direction in range(8):
                steps = distances[direction, y, x]
                if steps == 0:
                    continue
                nearest = min(nearest, steps)
                for far in range(2):
                    s = steps + far * SECOND_LOOK_PX
                    v, u = y + s * ROW_STEP[direction], x + s * COLUMN_STEP[direction]
                    if not (0 <= v < height and 0 <= u < width):
                        continue
                    if np.isnan(values[v, u]):
                        continue
                    du[looks], dv[looks], d[looks] = u - x, v - y, values[v, u]
                    total_sigma += sigma[v, u]
                    looks += 1
                    seconds += far
                    likest = min(likest, _difference(picture, y, x, v, u))
            # Open to the top of the picture is what the sky is.
            up = distances[NORTH, y, x] > 0 and (
                distances[NORTH_WEST, y, x] > 0 or distances[NORTH_EAST, y, x] > 0
            )
            sure = total_sigma <= UNSURE_PX * looks and likest <= OTHER_COLOUR
            if up and sure and looks >= LEAST_LOOKS and seconds >= LEAST_SECOND_LOOKS:
                moments[:] = 0.0
                right[:] = 0.0
                for i in range(looks):
                    moments[0] += 1.0
                    moments[1] += du[i]
                    moments[2] += dv[i]
                    moments[3] += du[i] * du[i]
                    moments[4] += du[i] * dv[i]
                    moments[5] += dv[i] * dv[i]
                    right[0] += d[i]
                    right[1] += d[i] * du[i]
                    right[2] += d[i] * dv[i]
                if _solve3(moments, right, plane):
                    worst = squares = 0.0
                    for i in range(looks):
                        off = d[i] - plane[0] - plane[1] * du[i] - plane[2] * dv[i]
                        worst = max(worst, abs(off))
                        squares += off * off
                    steep = max(abs(plane[1]), abs(plane[2]))
                    if worst <= tolerance and steep <= STEEPEST and plane[0] > 0:
                        kind[y, x] = SURFACE
                        out[y, x] = plane[0]
                        rim_sigma[y, x] = total_sigma / looks
                        off_plane[y, x] = np.sqrt(squares / looks)
                        away[y, x] = nearest
                        continue
            # The shadow of what stands on the right?
            step = front - behind
            if step < max(STEP_PX, STEP_SHARE * front) or run > SHADOW_SHARE * step + SHADOW_PX:
                continue
            left, beyond = x - west - SECOND_LOOK_PX, x + east + SECOND_LOOK_PX
            if left < 0 or beyond >= width:
                continue
            if not abs(values[y, left] - behind) <= tolerance:
                continue
            if not abs(values[y, beyond] - front) <= max(tolerance, OFF_PLANE_SHARE * front):
                continue
            # What hides it stands where the right eye sees it instead.
            hiding = x + int(np.rint(step))
            if hiding >= width or not abs(values[y, hiding] - front) <= max(
                OFF_PLANE_PX, STEP_SHARE / 2 * front
            ):
                continue
            here = _difference(picture, y, x, y, x - west)
            if here >= _difference(picture, y, x, y, x + east) or sigma[y, left] > UNSURE_PX:
                continue
            kind[y, x] = OCCLUSION
            out[y, x] = behind
            rim_sigma[y, x] = 0.5 * (sigma[y, left] + sigma[y, x - west])
            off_plane[y, x] = abs(values[y, left] - behind)
            away[y, x] = west
