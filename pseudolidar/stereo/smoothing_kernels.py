"""What follows the winner: speckle removal, masked mean, and the evidence that sigma is made of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from pseudolidar.stereo.sgm_kernels import AGREED, UNIQUE
from pseudolidar.structures.arrays import AnyArray

SMOOTHING_RADIUS = 3  # 7x7 window of the masked mean
# Neighbours within T = clip(share * d, smallest, largest) px belong to the same surface.
SURFACE_SHARE, SURFACE_SMALLEST_PX, SURFACE_LARGEST_PX = 0.12, 0.6, 3.0
# Neighbours (of 49) within this step that confirm a pixel: outliers fall by a twentieth at the same
# density on KITTI stereo 2015.
CONFIRMING_PIXELS, CONFIRMING_STEP_PX = 20, 1.0
NONE = np.float32(-1e4)  # stands for "no disparity" inside kernels: far from every surface
# Pixels (of 49) that a surface needs; fewer are spikes at depth edges.
SURFACE_PIXELS = 12
SPREAD_FLOOR_PX, DISTINCT_FLOOR = 0.02, 0.01
# Chebyshev fits: log2(m) on [1, 2) to 2e-4 and 2^y on [0, 1) to 1e-5; libm's would not vectorise.
LOG2 = (-2.4968059, 4.0284507, -2.0811287, 0.62884148, -0.079153837)
EXP2 = (1.0000073, 0.69293141, 0.24170999, 0.051667028, 0.013676561)

_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


@intrinsic
def _bits_of(_context: Any, value: Any) -> Any:
    def generate(cx: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], cx.get_value_type(types.int32))

    return types.int32(types.float32), generate


@intrinsic
def _float_of(_context: Any, bits: Any) -> Any:
    def generate(cx: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], cx.get_value_type(types.float32))

    return types.float32(types.int32), generate


@_kernel
def _log2(value: float) -> float:
    bits = _bits_of(value)
    m = _float_of((bits & np.int32(0x7FFFFF)) | np.int32(0x3F800000))
    p = np.float32(LOG2[3]) + m * np.float32(LOG2[4])
    p = np.float32(LOG2[1]) + m * (np.float32(LOG2[2]) + m * p)
    return np.float32((bits >> np.int32(23)) - np.int32(127)) + (np.float32(LOG2[0]) + m * p)


@_kernel
def _exp2(value: float) -> float:
    whole = np.int32(np.floor(value))
    y = value - np.float32(whole)
    p = np.float32(EXP2[3]) + y * np.float32(EXP2[4])
    p = np.float32(EXP2[0]) + y * (np.float32(EXP2[1]) + y * (np.float32(EXP2[2]) + y * p))
    return p * _float_of((whole + np.int32(127)) << np.int32(23))


@_kernel
def accept(disparity: AnyArray, verdict: AnyArray) -> AnyArray:
    """(H, W) bool: unique pixels, and agreed ones that enough unique neighbours confirm.

    Uniqueness alone would throw away what repeats or lacks texture although its surface is known.
    """
    height, width = disparity.shape
    radius = SMOOTHING_RADIUS
    valid = np.empty((height, width), np.bool_)
    for y in range(height):
        for x in range(width):
            d = disparity[y, x]
            valid[y, x] = verdict[y, x] == UNIQUE and d > 0
            if verdict[y, x] != AGREED or d <= 0:
                continue
            count = 0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    near = abs(disparity[v, u] - d) < np.float32(CONFIRMING_STEP_PX)
                    count += verdict[v, u] == UNIQUE and near
            valid[y, x] = count >= CONFIRMING_PIXELS
    return valid


@_kernel
def _root(parents: AnyArray, label: int) -> int:
    while parents[label] != label:
        parents[label] = parents[parents[label]]
        label = parents[label]
    return label


@_kernel
def remove_speckles(
    disparity: AnyArray, valid: AnyArray, max_step_px: float, min_pixels: int
) -> None:
    """Clear `valid` in 4-connected segments smaller than `min_pixels`.

    Neighbours are connected where both are valid and differ by at most `max_step_px`.
    """
    height, width = disparity.shape
    labels = np.empty((height, width), np.int32)
    parents = np.empty(height * width + 1, np.int32)
    sizes = np.zeros(height * width + 1, np.int32)
    step = np.float32(max_step_px)
    count = 0
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            d = disparity[y, x]
            if x > 0 and valid[y, x - 1] and abs(disparity[y, x - 1] - d) <= step:
                label = labels[y, x - 1]
            else:
                label = count
                parents[count] = count
                count += 1
            labels[y, x] = label
            sizes[label] += 1
            if y > 0 and valid[y - 1, x] and abs(disparity[y - 1, x] - d) <= step:
                a, b = _root(parents, label), _root(parents, labels[y - 1, x])
                if a != b:
                    parents[max(a, b)] = min(a, b)
    for label in range(count - 1, -1, -1):
        if parents[label] != label:
            sizes[parents[label]] += sizes[label]
    for label in range(count):
        parents[label] = parents[parents[label]]
    for y in range(height):
        for x in range(width):
            if valid[y, x] and sizes[parents[labels[y, x]]] < min_pixels:
                valid[y, x] = False


@_kernel
def _look(d: float, centre: float, threshold: float) -> tuple[float, float, float, float]:
    """What one neighbour adds: to the sum, the surface count, the valid count, the spread."""
    one, zero = np.float32(1), np.float32(0)
    deviation = abs(d - centre)
    near = deviation < threshold
    exists = d > zero
    return (
        d if near else zero,
        one if near else zero,
        one if exists else zero,
        min(deviation, threshold) if exists else zero,
    )


@_kernel
def smooth(
    padded: AnyArray, mean: AnyArray, support: AnyArray, same: AnyArray, spread: AnyArray
) -> None:
    """Masked mean of each pixel over its 7x7 window, with what the window tells about its error.

    Args:
        padded: (H + 6, W + 6) float32 px, `NONE` where there is no disparity.
        mean: (H, W) out: mean of the neighbours of the same surface, px; `NONE` where none is
            or the surface is too small.
        support: (H, W) out: number of valid pixels in the window.
        same: (H, W) out: number of those on the same surface.
        spread: (H, W) out: sum over valid pixels of the deviation from the centre, each at most T.
    """
    height, width = mean.shape
    radius = SMOOTHING_RADIUS
    share = np.float32(SURFACE_SHARE)
    smallest, largest = np.float32(SURFACE_SMALLEST_PX), np.float32(SURFACE_LARGEST_PX)
    threshold = np.empty(width, np.float32)
    for y in range(height):
        centre = padded[y + radius, radius : radius + width]
        total, n, k, s = mean[y], support[y], same[y], spread[y]
        for x in range(width):
            threshold[x] = max(smallest, min(largest, share * centre[x]))
            total[x] = n[x] = k[x] = s[x] = np.float32(0)
        for dy in range(2 * radius + 1):
            row = padded[y + dy]
            for x in range(width):
                c, t = centre[x], threshold[x]
                t0, k0, n0, s0 = _look(row[x], c, t)
                t1, k1, n1, s1 = _look(row[x + 1], c, t)
                t2, k2, n2, s2 = _look(row[x + 2], c, t)
                t3, k3, n3, s3 = _look(row[x + 3], c, t)
                t4, k4, n4, s4 = _look(row[x + 4], c, t)
                t5, k5, n5, s5 = _look(row[x + 5], c, t)
                t6, k6, n6, s6 = _look(row[x + 6], c, t)
                total[x] += t0 + t1 + t2 + t3 + t4 + t5 + t6
                k[x] += k0 + k1 + k2 + k3 + k4 + k5 + k6
                n[x] += n0 + n1 + n2 + n3 + n4 + n5 + n6
                s[x] += s0 + s1 + s2 + s3 + s4 + s5 + s6
        for x in range(width):
            alone = centre[x] <= 0 or k[x] < SURFACE_PIXELS
            total[x] = NONE if alone else total[x] / k[x]


@_kernel
def _term(value: float, model: AnyArray, j: int) -> float:
    f = max(model[0, j], min(model[1, j], value))
    return f * (model[2, j] + f * model[3, j])


@_kernel
def sigma(
    mean: AnyArray,
    support: AnyArray,
    same: AnyArray,
    spread: AnyArray,
    distinctness: AnyArray,
    model: AnyArray,
    out: AnyArray,
) -> None:
    """Sigma px of each pixel by `SigmaModel.as_array`; NaN, in `mean` too, where there is none."""
    height, width = mean.shape
    one, nan = np.float32(1), np.float32(np.nan)
    window = np.float32((2 * SMOOTHING_RADIUS + 1) ** 2)
    for y in range(height):
        d, n, k, s, u, target = mean[y], support[y], same[y], spread[y], distinctness[y], out[y]
        for x in range(width):
            count = max(n[x], one)
            log_sigma = model[4, 0] + _term(n[x] / window, model, 0)
            log_sigma += _term(k[x] / count, model, 1)
            log_sigma += _term(_log2(max(d[x], np.float32(DISTINCT_FLOOR))), model, 2)
            log_sigma += _term(_log2(np.float32(SPREAD_FLOOR_PX) + s[x] / count), model, 3)
            log_sigma += _term(_log2(max(u[x], np.float32(DISTINCT_FLOOR))), model, 4)
            valid = d[x] > 0
            target[x] = _exp2(log_sigma) if valid else nan
            d[x] = d[x] if valid else nan
