"""Passes over a disparity map that mark what is no surface; import it late: it loads numba."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pseudolidar.structures.arrays import AnyArray

# Why a pixel was removed; 0 is kept, or had no disparity from the start.
SKY, NEAR, FLYING, FAR, SPECKLE, ISOLATED = range(1, 7)
# Half width of the window that shows whether there is a depth edge, px.
EDGE_REACH = 3
# Share of the window that has a disparity where there is no edge: matchers leave holes beside one.
WHOLE_SHARE = 0.95
# The nearer side of an edge is what matchers are surer of: its error may be so many times as large;
# and that of things with the background on both sides within so many columns, for a thin thing has
# no inside that would be without an edge.
FRONT_FACTOR = 2.0
THIN_FACTOR, THIN_REACH = 4.0, 18
# No surface worth keeping is steeper than this, px of disparity per pixel: a road seen from 1.1 m
# above with eyes 0.54 m apart.
STEEPEST = 0.5
# Distance of the pixels that show how a surface is slanted, px.
SLANT_REACH = 3
# The slopes above and below a pixel of a slanted surface differ by less than this share.
BENT = 0.3
# Half width of the neighbourhood that a point is isolated in, px.
LONELY_REACH = 2
_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@_kernel
def split(values: AnyArray, low: AnyArray, high: AnyArray, valid: AnyArray) -> None:
    """Copies of a map for the largest and the smallest of a window, and its valid pixels (0, 1)."""
    height, width = values.shape
    none, far, one, zero = np.float32(-1e4), np.float32(1e4), np.float32(1), np.float32(0)
    for y in range(height):
        row, down, up, known = values[y], low[y], high[y], valid[y]
        for x in range(width):
            d = row[x]
            exists = d == d
            down[x] = d if exists else none
            up[x] = d if exists else far
            known[x] = one if exists else zero


@_kernel
def mark_unseen(values: AnyArray, reason: AnyArray) -> None:
    """Mark pixels whose match would lie left of the right image."""
    height, width = values.shape
    for y in range(height):
        for x in range(width):
            if values[y, x] - np.float32(0.5) > x:
                reason[y, x] = NEAR


@_kernel
def mark_edges(
    values: AnyArray,
    sigma: AnyArray,
    rows: tuple[int, int],
    window: tuple[AnyArray, AnyArray, AnyArray, AnyArray, AnyArray],
    rig: AnyArray,
    limits: AnyArray,
    flying: bool,
    far: bool,
    reason: AnyArray,
) -> None:
    """Mark pixels between two surfaces, unsure ones at depth edges, and those that mean no depth.

    Args:
        values: (H, W) px, NaN = none.
        sigma: (H, W) px, or (0, 0) when there is none.
        rows: first and last + 1 to work on.
        window: (rows, W) each: largest and smallest disparity of the window around each pixel of
            these rows, the share of it that has a disparity, and the smallest of the columns on the
            left and on the right (`THIN_REACH`).
        rig: (3,) f px, f B px m, doffs px.
        limits: (6,) slope of the steepest surface as tan of the angle to the ray, gap in sigmas,
            tolerance m, tolerance relative to depth, its share at edges, and anywhere.
        flying: whether the first two are wanted.
        far: whether the last is.
        reason: (H, W) out.
    """
    width = values.shape[1]
    fB, doffs = np.float32(rig[1]), np.float32(rig[2])
    per_px = np.float32(1.0 / (rig[0] * limits[0]))
    sigmas, tolerance_m = np.float32(limits[1]), np.float32(limits[2])
    tolerance, at_edge = np.float32(limits[3] * rig[1]), np.float32(limits[4])
    anywhere, front = np.float32(limits[5]), np.float32(limits[4] * FRONT_FACTOR)
    thin = np.float32(limits[4] * THIN_FACTOR)
    reach, steepest = np.float32(EDGE_REACH), np.float32(STEEPEST)
    whole, zero = np.float32(WHOLE_SHARE), np.float32(0)
    none = np.zeros(width, np.float32)
    gaps, flags = np.empty(width, np.float32), np.empty(width, np.uint8)
    slant = (np.float32(rig[0]), fB, doffs, at_edge * tolerance_m, at_edge * np.float32(limits[3]))
    for y in range(rows[0], rows[1]):
        line, why = values[y], reason[y]
        spread = none if sigma.size == 0 else sigma[y]
        largest, smallest = window[0][y - rows[0]], window[1][y - rows[0]]
        share, left, right = window[2][y - rows[0]], window[3][y - rows[0]], window[4][y - rows[0]]
        for x in range(width):
            d, s = line[x], spread[x]
            to_infinity = d + doffs
            # sigma_Z > k (m + rel Z) with Z = f B / (d + doffs), multiplied by (d + doffs)^2.
            error = fB * s
            allowed = to_infinity * (tolerance_m * to_infinity + tolerance)
            gap = max(reach * max(steepest, to_infinity * per_px), sigmas * s)
            before, behind = largest[x] - d > gap, d - smallest[x] > gap
            edge = before | behind | (share[x] < whole)
            free = (d - left[x] > gap) & (d - right[x] > gap)
            trusted = at_edge if before else (thin if free else (front if behind else at_edge))
            gaps[x] = gap
            means_nothing = (to_infinity <= zero) | (error > anywhere * allowed)
            flags[x] = (
                np.uint8(means_nothing)
                | (np.uint8(edge & (error > trusted * allowed)) << 1)
                | (np.uint8(before & behind) << 2)
            )
        for x in range(width):
            flag, d = flags[x], line[x]
            if flag == 0 or why[x] != 0 or d != d:
                continue
            unsure = flag & 3 and not _slanted(values, y, x, d, spread[x], slant)
            if far and flag & 1 and (unsure or d + doffs <= zero):
                why[x] = FAR
            elif flying and (
                (flag & 2 and unsure) or (flag & 4 and _between(values, y, x, d, gaps[x]))
            ):
                why[x] = FLYING


@_kernel
def _slanted(
    values: AnyArray, y: int, x: int, d: float, s: float, slant: tuple[float, ...]
) -> bool:
    """Whether the surface is so slanted that an error along the ray stays near to it: a road.

    Three pixels of a column lie on one slope that comes nearer downwards; n pixels along it, the
    disparity is another by sigma. So far is the point from its surface across the ray, n Z / f.
    """
    height = len(values)
    f, fB, doffs, tolerance_m, tolerance_rel = slant
    depth_m = fB / (d + doffs)
    allowed_px = (tolerance_m + tolerance_rel * depth_m) * f / depth_m
    reach = SLANT_REACH
    if not (y >= reach and y + reach < height):
        return False
    below, above = values[y + reach, x] - d, d - values[y - reach, x]
    slope = (below + above) / np.float32(2 * reach)
    bent = abs(below - above) > np.float32(BENT) * (below + above)
    # False for NaN
    return slope <= STEEPEST and below > 0 and above > 0 and not bent and s <= slope * allowed_px


@_kernel
def _between(values: AnyArray, y: int, x: int, d: float, gap: float) -> bool:
    """Whether a nearer surface lies on one side and a farther one on the opposite side."""
    height, width = values.shape
    reach = EDGE_REACH
    for k in range(4):
        dy, dx = _DIRECTIONS[k]
        dy, dx = reach * dy, reach * dx
        inside = y >= dy and y + dy < height and x >= abs(dx) and x + abs(dx) < width
        if not inside:
            continue
        a, b = values[y + dy, x + dx] - d, values[y - dy, x - dx] - d
        if (a > gap and b < -gap) or (a < -gap and b > gap):
            return True
    return False


@_kernel
def _root(parents: AnyArray, label: int) -> int:
    while parents[label] != label:
        parents[label] = parents[parents[label]]
        label = parents[label]
    return label


@_kernel
def mark_speckles(
    values: AnyArray,
    reason: AnyArray,
    link_px: float,
    link_rel: float,
    baseline_m: float,
    doffs_px: float,
    min_m2: float,
    pixel_m2: float,
    lens_px: float,
    near_px: float,
) -> None:
    """Mark small surfaces on their own: 4-connected parts with less area than `min_m2`.

    Neighbours hang together where their disparities differ by at most `link_px + link_rel d`. A
    pixel at disparity d covers (B / (d + doffs))^2 square metres, B the baseline, and up to
    `lens_px` of disparity counts for no less than `pixel_m2`. Parts nearer than `near_px` of
    disparity are marked as near-lens noise.
    `values` are NaN where there is none, or where it was removed already.
    """
    height, width = values.shape
    most = height * width
    row_of, first_of, last_of = (
        np.empty(most, np.int32),
        np.empty(most, np.int32),
        np.empty(most, np.int32),
    )
    parents, area = np.empty(most, np.int32), np.empty(most, np.float32)
    above, here = np.full(width, -1, np.int32), np.full(width, -1, np.int32)
    step, relative = np.float32(link_px), np.float32(link_rel)
    count = 0
    for y in range(height):
        x = 0
        while x < width:
            d = values[y, x]
            if d != d:
                here[x] = -1
                x += 1
                continue
            first, total = x, np.float32(0)
            while True:
                here[x] = count
                total += d
                x += 1
                if x == width:
                    break
                following = values[y, x]
                if not abs(following - d) <= step + relative * d:
                    break
                d = following
            n = np.float32(x - first)
            side = np.float32(baseline_m) / max(total / n + np.float32(doffs_px), np.float32(1e-3))
            least = np.float32(pixel_m2) if total <= n * np.float32(lens_px) else np.float32(0)
            row_of[count], first_of[count], last_of[count] = y, first, x
            parents[count], area[count] = count, n * max(side * side, least)
            count += 1
        if y > 0:
            joined_above, joined_here = -1, -1
            for x in range(width):
                a, b = here[x], above[x]
                if a < 0 or b < 0 or (a == joined_here and b == joined_above):
                    continue
                d = values[y, x]
                if abs(values[y - 1, x] - d) <= step + relative * d:
                    joined_here, joined_above = a, b
                    p, q = _root(parents, a), _root(parents, b)
                    if p != q:
                        parents[max(p, q)] = min(p, q)
        above, here = here, above
    for k in range(count - 1, -1, -1):
        if parents[k] != k:
            area[parents[k]] += area[k]
    for k in range(count):
        parents[k] = parents[parents[k]]
        if area[parents[k]] < min_m2:
            y = row_of[k]
            for x in range(first_of[k], last_of[k]):
                reason[y, x] = NEAR if values[y, x] > near_px else SPECKLE


@_kernel
def mark_isolated(
    values: AnyArray,
    sigma: AnyArray,
    reason: AnyArray,
    rig: AnyArray,
    sigmas: float,
    neighbours: int,
) -> None:
    """Mark points with fewer than `neighbours` points around them.

    Around is within 2 px to each side, and along the ray within what 2 px measure across it at that
    depth, or what the steepest surface or `sigmas` of the point's error make of them.

    Args:
        values: (H, W) px, NaN = none, or removed already.
        sigma: (H, W) px, or (0, 0) when there is none.
        reason: (H, W) out.
        rig: (3,) f px, f B px m, doffs px.
        sigmas: step in disparity that noise may make.
        neighbours: that a point needs, of the 24 around it.
    """
    height, width = values.shape
    # n pixels' width in depth, n Z / f = Z^2 / fB dd, is a step of n (d + doffs) / (f / B) / B.
    per_px, doffs = np.float32(1.0 / rig[0]), np.float32(rig[2])
    factor, steepest, reach = np.float32(sigmas), np.float32(STEEPEST), LONELY_REACH
    across, one, zero = np.float32(reach), np.uint8(1), np.uint8(0)
    nothing = np.full(width, np.nan, np.float32)
    none = np.zeros(width, np.float32)
    near, beside = np.empty(width, np.float32), np.empty(width, np.uint8)
    for y in range(height):
        line, spread = values[y], none if sigma.size == 0 else sigma[y]
        above = values[y - 1] if y > 0 else nothing
        below = values[y + 1] if y < height - 1 else nothing
        for x in range(width):
            d = line[x]
            near[x] = max(factor * spread[x], across * max((d + doffs) * per_px, steepest))
            beside[x] = (one if abs(above[x] - d) <= near[x] else zero) + (
                one if abs(below[x] - d) <= near[x] else zero
            )
        for x in range(1, width - 1):
            d = line[x]
            beside[x] += (one if abs(line[x - 1] - d) <= near[x] else zero) + (
                one if abs(line[x + 1] - d) <= near[x] else zero
            )
        for x in range(width):
            d = line[x]
            if beside[x] >= neighbours or d != d:
                continue
            count = -1  # the point itself
            for v in range(max(y - reach, 0), min(y + reach + 1, height)):
                for u in range(max(x - reach, 0), min(x + reach + 1, width)):
                    count += abs(values[v, u] - d) <= near[x]
                if count >= neighbours:
                    break
            if count < neighbours:
                reason[y, x] = ISOLATED


@_kernel
def erase(values: AnyArray, sigma: AnyArray, reason: AnyArray) -> None:
    """NaN where there is a reason."""
    height, width = values.shape
    nan = np.float32(math.nan)
    for y in range(height):
        for x in range(width):
            if reason[y, x] != 0:
                values[y, x] = nan
                if sigma.size != 0:
                    sigma[y, x] = nan


@_kernel
def count_reasons(values: AnyArray, reason: AnyArray, counts: AnyArray) -> None:
    """How many pixels each reason took; first those that still have a disparity."""
    height, width = values.shape
    for y in range(height):
        kept = 0
        for x in range(width):
            kept += values[y, x] == values[y, x]
        counts[0] += kept
        for x in range(width):
            if reason[y, x] != 0:
                counts[reason[y, x]] += 1
