"""Census cost and semi-global aggregation in two fused sweeps, vectorised by hand for LLVM.

One sweep visits the image row by row and sums two paths, along the row and along the column; the
other visits it in the opposite order, adds the opposite paths and picks the winner at once, so that
the sum of all four is never stored. Costs are recomputed per row in each sweep.

Path costs are uint8. A normalised path never exceeds `LARGEST_COST + penalty_large`, and two of
them must fit in one byte, hence `LARGEST_COST + penalty_large <= 127`.

All of it is in one file because the kernel cache looks at the file of the cached function alone.

Source: Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual Information, 2008,
eq. 13; census: Zabih and Woodfill 1994, on the checkerboard half of a 9x7 window.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from pseudolidar.structures.arrays import AnyArray

LARGEST_COST = 32  # bits of the census descriptor
LANES = 32  # bins in one vector; the number of bins is a multiple of it
AGREED, UNIQUE = 1, 2  # verdict on a pixel: both eyes agree; and the winner is unique besides
GUARD = 64  # bytes of 255 around the path costs of a pixel, so that bins -1 and D never win
CENSUS_RADIUS_X, CENSUS_RADIUS_Y = 4, 3

_BYTE, _WORD, _LONG = ir.IntType(8), ir.IntType(16), ir.IntType(64)
_BYTES, _WORDS = ir.VectorType(_BYTE, LANES), ir.VectorType(_WORD, LANES)
_TWO_ADDRESSES = types.UniTuple(types.intp, 2)
_TWO_MINIMA = types.UniTuple(types.uint8, 2)
_WINNER = types.UniTuple(types.uint16, 5)
# C division semantics: a test for zero in every lane would forbid vectors.
_kernel = njit(nogil=True, cache=True, boundscheck=False, error_model="numpy")


def _constant(value: int) -> Any:
    return ir.Constant(_LONG, value)


class _Vectors:
    """The vector operations that a path step is made of, written into an LLVM builder."""

    def __init__(self, builder: Any) -> None:
        self.b = builder

    def call(self, name: str, result: Any, *args: Any) -> Any:
        kind = ir.FunctionType(result, [a.type for a in args])
        return self.b.call(cgutils.get_or_insert_function(self.b.module, kind, name), args)

    def umin(self, a: Any, b: Any) -> Any:
        return self.call(f"llvm.umin.v{LANES}i{a.type.element.width}", a.type, a, b)

    def add_saturated(self, a: Any, b: Any) -> Any:
        return self.call(f"llvm.uadd.sat.v{LANES}i8", a.type, a, b)

    def smallest(self, vector: Any) -> Any:
        element = vector.type.element
        return self.call(f"llvm.vector.reduce.umin.v{LANES}i{element.width}", element, vector)

    def splat(self, scalar: Any) -> Any:
        vector, i32 = ir.VectorType(scalar.type, LANES), ir.IntType(32)
        undefined = ir.Constant(vector, ir.Undefined)
        one = self.b.insert_element(undefined, scalar, ir.Constant(i32, 0))
        order = ir.Constant(ir.VectorType(i32, LANES), [0] * LANES)
        return self.b.shuffle_vector(one, undefined, order)

    def load(self, address: Any, kind: Any, align: int = LANES) -> Any:
        value = self.b.load(self.b.inttoptr(address, kind.as_pointer()))
        value.align = align
        return value

    def store(self, value: Any, address: Any) -> Any:
        stored = self.b.store(value, self.b.inttoptr(address, value.type.as_pointer()))
        stored.align = LANES
        return stored

    def store_past_cache(self, value: Any, address: Any) -> None:
        """Store what is not read again soon, without reading its cache line first."""
        hint = self.b.module.add_metadata([ir.Constant(ir.IntType(32), 1)])
        self.store(value, address).set_metadata("nontemporal", hint)

    def running_minimum(self, kind: Any) -> Any:
        ones = (1 << kind.element.width) - 1
        return cgutils.alloca_once_value(self.b, ir.Constant(kind, [ones] * LANES))

    def keep_smaller(self, variable: Any, value: Any) -> None:
        self.b.store(self.umin(self.b.load(variable), value), variable)


class _PathStep:
    """Eq. 13 for one pixel and two paths: `c + min(same, near + P1, min + P2) - min`."""

    def __init__(
        self,
        vectors: _Vectors,
        cost: Any,
        previous: Any,
        current: Any,
        minima: Any,
        penalty_small: Any,
        penalty_large: Any,
    ) -> None:
        v, b = vectors, vectors.b
        self.v, self.cost, self.small = v, cost, v.splat(penalty_small)
        self.previous, self.current, minimum = (
            [b.extract_value(pair, k) for k in (0, 1)] for pair in (previous, current, minima)
        )
        self.minimum = [v.splat(m) for m in minimum]
        self.jump = [v.splat(v.call("llvm.uadd.sat.i8", _BYTE, m, penalty_large)) for m in minimum]
        self.smallest = [v.running_minimum(_BYTES) for _ in (0, 1)]

    def sum_at(self, offset: Any) -> Any:
        """Store the path costs of the bins at `offset`; return the sum of both paths."""
        v, b = self.v, self.v.b
        cost = v.load(b.add(self.cost, offset), _BYTES)
        paths = []
        for k in (0, 1):
            here = b.add(self.previous[k], offset)
            below, above = (v.load(b.add(here, _constant(s)), _BYTES, 1) for s in (-1, 1))
            near = v.add_saturated(v.umin(below, above), self.small)
            best = v.umin(v.umin(v.load(here, _BYTES), self.jump[k]), near)
            path = b.add(b.sub(best, self.minimum[k]), cost)
            v.store(path, b.add(self.current[k], offset))
            v.keep_smaller(self.smallest[k], path)
            paths.append(path)
        return b.add(*paths)

    def minima(self) -> list[Any]:
        """Smallest cost of each path at this pixel."""
        return [self.v.smallest(self.v.b.load(variable)) for variable in self.smallest]


def _each_vector(v: _Vectors, bins: Any, body: Callable[[Any], None]) -> None:
    with cgutils.for_range(v.b, v.b.udiv(bins, _constant(LANES))) as loop:
        body(v.b.mul(loop.index, _constant(LANES)))


@intrinsic
def _popcount(_context: Any, value: Any) -> Any:
    return value(value), lambda _cx, builder, _signature, args: builder.ctpop(args[0])


@intrinsic
def _step_and_store(
    _context: Any,
    cost: Any,
    total: Any,
    bins: Any,
    previous: Any,
    current: Any,
    minima: Any,
    penalty_small: Any,
    penalty_large: Any,
) -> Any:
    """One pixel of two paths; their sum goes to `total`. Returns the new minima."""

    def generate(_cx: Any, builder: Any, _signature: Any, args: Any) -> Any:
        cost, total, bins, *state = args
        v = _Vectors(builder)
        step = _PathStep(v, cost, *state)

        def body(offset: Any) -> None:
            v.store_past_cache(step.sum_at(offset), builder.add(total, offset))

        _each_vector(v, bins, body)
        return cgutils.pack_array(builder, step.minima())

    arguments = (types.intp,) * 3 + (_TWO_ADDRESSES,) * 2 + (_TWO_MINIMA,) + (types.uint8,) * 2
    return _TWO_MINIMA(*arguments), generate


@intrinsic
def _step_and_win(
    _context: Any,
    cost: Any,
    total: Any,
    sums: Any,
    bins: Any,
    exclude: Any,
    previous: Any,
    current: Any,
    minima: Any,
    penalty_small: Any,
    penalty_large: Any,
) -> Any:
    """One pixel of two paths, added to `total`; all four sums go to `sums` (uint16).

    Returns new minima, the winning bin, its sum, and the best sum outside `exclude` bins of it.
    """

    def generate(_cx: Any, builder: Any, _signature: Any, args: Any) -> Any:
        cost, total, sums, bins, exclude, *state = args
        b, v = builder, _Vectors(builder)
        step = _PathStep(v, cost, *state)
        lane = ir.Constant(_WORDS, list(range(LANES)))
        worst = ir.Constant(_WORDS, [0xFFFF] * LANES)
        best, second = v.running_minimum(_WORDS), v.running_minimum(_WORDS)
        winner = cgutils.alloca_once_value(b, ir.Constant(_WORDS, [0] * LANES))

        def bins_at(offset: Any) -> Any:
            return b.add(v.splat(b.trunc(offset, _WORD)), lane)

        def words_at(offset: Any) -> Any:
            return b.add(sums, b.shl(offset, _constant(1)))

        def aggregate(offset: Any) -> None:
            stored = b.zext(v.load(b.add(total, offset), _BYTES), _WORDS)
            value = b.add(stored, b.zext(step.sum_at(offset), _WORDS))
            v.store(value, words_at(offset))
            better = b.icmp_unsigned("<", value, b.load(best))
            b.store(b.select(better, value, b.load(best)), best)
            b.store(b.select(better, bins_at(offset), b.load(winner)), winner)

        _each_vector(v, bins, aggregate)
        lowest = v.smallest(b.load(best))
        tied = b.icmp_unsigned("==", b.load(best), v.splat(lowest))
        bin_ = v.smallest(b.select(tied, b.load(winner), worst))
        first, span = v.splat(b.sub(bin_, exclude)), v.splat(b.add(exclude, exclude))

        def runner_up(offset: Any) -> None:
            outside = b.icmp_unsigned(">", b.sub(bins_at(offset), first), span)
            value = v.load(words_at(offset), _WORDS)
            v.keep_smaller(second, b.select(outside, value, worst))

        _each_vector(v, bins, runner_up)
        minima = [b.zext(m, _WORD) for m in step.minima()]
        return cgutils.pack_array(b, [*minima, bin_, lowest, v.smallest(b.load(second))])

    arguments = (types.intp,) * 4 + (types.uint16,) + (_TWO_ADDRESSES,) * 2
    return _WINNER(*arguments, _TWO_MINIMA, types.uint8, types.uint8), generate


@_kernel
def census_transform(padded: AnyArray, descriptors: AnyArray) -> None:
    """Fill `descriptors` (H, W) uint32 from the image padded by the census radii.

    Bit k is set where the k-th checkerboard neighbour, in row-major order, is darker.
    """
    height, width = descriptors.shape
    for y in range(height):
        row = descriptors[y]
        row[:] = 0
        centre = padded[y + CENSUS_RADIUS_Y, CENSUS_RADIUS_X : CENSUS_RADIUS_X + width]
        bit = np.uint32(0)
        for dy in range(-CENSUS_RADIUS_Y, CENSUS_RADIUS_Y + 1):
            for dx in range(-CENSUS_RADIUS_X, CENSUS_RADIUS_X + 1):
                if (dx + dy) % 2 == 0 or bit >= LARGEST_COST:
                    continue
                x0 = CENSUS_RADIUS_X + dx
                other = padded[y + CENSUS_RADIUS_Y + dy, x0 : x0 + width]
                for x in range(width):
                    row[x] |= np.uint32(other[x] < centre[x]) << bit
                bit += np.uint32(1)


@_kernel
def _cost_row(
    left: AnyArray, right: AnyArray, half: AnyArray, half_bins: int, bins: int, cost: AnyArray
) -> None:
    """Hamming distances of one row: `cost[x * bins + k]`.

    Bins below `half_bins` are half pixels, k / 2, looked up in `half`; the others follow in whole
    pixels, looked up in `right`. Both are stored with x reversed, so that k runs forward in memory.
    Bins that look outside the right image cost the most.
    """
    width = left.size
    shift = half_bins // 2
    for x in range(width):
        word = left[x]
        mirrored = width - 1 - x
        fine = cost[x * bins : x * bins + half_bins]
        candidates = half[2 * mirrored : 2 * mirrored + half_bins]
        for k in range(half_bins):
            fine[k] = np.uint8(_popcount(word ^ candidates[k]))
        for k in range(2 * x + 1, half_bins):
            fine[k] = LARGEST_COST
        whole = cost[x * bins + half_bins : (x + 1) * bins]
        candidates = right[mirrored + shift : mirrored + shift + bins - half_bins]
        for k in range(bins - half_bins):
            whole[k] = np.uint8(_popcount(word ^ candidates[k]))
        for k in range(max(0, x + 1 - shift), bins - half_bins):
            whole[k] = LARGEST_COST


@_kernel
def _disparity_row(
    winners: AnyArray,
    half_bins: int,
    uniqueness: float,
    agreement_px: float,
    cheapest: AnyArray,
    kept: AnyArray,
    disparity: AnyArray,
    verdict: AnyArray,
    distinctness: AnyArray,
) -> None:
    """Sub-pixel disparity, left-right check and uniqueness of one row.

    `winners` is (5, W): bin, sum, second best sum, sums below and above the bin. The sub-pixel
    step is equiangular. Each right pixel keeps the disparity of its cheapest left pixel, and a left
    pixel must agree with what its right pixel kept.
    """
    width = winners.shape[1]
    bins, lowest, second, below, above = winners
    for x in range(width):
        best = np.float32(lowest[x])
        low, high = np.float32(below[x]) - best, np.float32(above[x]) - best
        steepest = max(np.float32(2) * max(low, high), np.float32(1))
        step = (low - high) / steepest
        k = np.float32(bins[x])
        half = np.float32(half_bins)
        fine = np.float32(0.5) * (k + step)
        # at the seam the bin below is half a pixel away
        coarse = k - np.float32(0.5) * half + (np.float32(0.5) * step if k == half else step)
        coarse = k - np.float32(0.5) * half + step if step >= 0 or k > half else coarse
        disparity[x] = fine if k < half else coarse
        distinctness[x] = (np.float32(second[x]) - best) / (best + np.float32(1))
        unique = np.float32(second[x]) * (np.float32(1) - uniqueness) >= best
        verdict[x] = UNIQUE if unique else AGREED
        cheapest[x] = 0xFFFF
    for x in range(width):
        d = disparity[x]
        target = int(np.float32(x) - d + np.float32(0.5))
        if target >= 0 and lowest[x] < cheapest[target]:
            cheapest[target] = lowest[x]
            kept[target] = d
    for x in range(width):
        d = disparity[x]
        target = int(np.float32(x) - d + np.float32(0.5))
        agrees = abs(kept[max(target, 0)] - d) <= agreement_px
        verdict[x] = verdict[x] if agrees & (d > 0) & (d <= x) else 0


@_kernel
def sweep_and_store(
    left: AnyArray,
    right: AnyArray,
    half: AnyArray,
    half_bins: int,
    bins: int,
    penalties: tuple[int, int],
    mirrored: bool,
    rows: tuple[int, int],
    state: tuple[AnyArray, AnyArray, AnyArray, AnyArray, AnyArray],
    total: AnyArray,
) -> None:
    """First sweep over `rows` [from, to) in its own order; `total` (H, W, bins) gets the sums.

    `mirrored` visits rows from the bottom and columns from the right. `state` (see `PathState`)
    carries the vertical path from call to call.
    """
    cost, column, line, minima, _ = state
    height, width = left.shape
    stride = bins + GUARD
    small, large = np.uint8(penalties[0]), np.uint8(penalties[1])
    costs, totals = np.int64(cost.ctypes.data), np.int64(total.ctypes.data)
    lines = np.int64(line.ctypes.data) + GUARD
    for row in range(rows[0], rows[1]):
        y = height - 1 - row if mirrored else row
        _cost_row(left[y], right[y], half[y], half_bins, bins, cost)
        line[GUARD : GUARD + bins] = 0
        along, parity = np.uint8(0), 0
        slot = np.int64(column.ctypes.data) + GUARD + (height - 1 - row) * stride
        for i in range(width):
            x = width - 1 - i if mirrored else i
            along, minima[i] = _step_and_store(
                costs + x * bins,
                totals + (y * width + x) * bins,
                bins,
                (lines + parity * stride, slot + stride),
                (lines + (1 - parity) * stride, slot),
                (along, minima[i]),
                small,
                large,
            )
            parity, slot = 1 - parity, slot + stride


@_kernel
def sweep_and_win(
    left: AnyArray,
    right: AnyArray,
    half: AnyArray,
    half_bins: int,
    bins: int,
    penalties: tuple[int, int],
    mirrored: bool,
    rows: tuple[int, int],
    state: tuple[AnyArray, AnyArray, AnyArray, AnyArray, AnyArray],
    total: AnyArray,
    checks: tuple[float, float],
    disparity: AnyArray,
    verdict: AnyArray,
    distinctness: AnyArray,
) -> None:
    """Second sweep: adds `total` of the first (in the opposite order) and decides each pixel.

    `checks` is (uniqueness, left-right agreement in px). Fills (H, W) disparity float32 px,
    verdict uint8 (0, `AGREED` or `UNIQUE`) and distinctness float32, (second best sum - best) /
    (best + 1).
    """
    cost, column, line, minima, sums = state
    height, width = left.shape
    stride = bins + GUARD
    small, large = np.uint8(penalties[0]), np.uint8(penalties[1])
    exclude = np.uint16(2 if half_bins else 1)
    costs, totals = np.int64(cost.ctypes.data), np.int64(total.ctypes.data)
    lines, words = np.int64(line.ctypes.data) + GUARD, np.int64(sums.ctypes.data)
    winners = np.empty((5, width), np.uint16)
    cheapest, kept = np.empty(width, np.uint16), np.zeros(width, np.float32)
    uniqueness, agreement_px = np.float32(checks[0]), np.float32(checks[1])
    for row in range(rows[0], rows[1]):
        y = height - 1 - row if mirrored else row
        _cost_row(left[y], right[y], half[y], half_bins, bins, cost)
        line[GUARD : GUARD + bins] = 0
        along, parity = np.uint8(0), 0
        slot = np.int64(column.ctypes.data) + GUARD + (height - 1 - row) * stride
        for i in range(width):
            x = width - 1 - i if mirrored else i
            result = _step_and_win(
                costs + x * bins,
                totals + (y * width + x) * bins,
                words,
                bins,
                exclude,
                (lines + parity * stride, slot + stride),
                (lines + (1 - parity) * stride, slot),
                (along, minima[i]),
                small,
                large,
            )
            along, minima[i] = np.uint8(result[0]), np.uint8(result[1])
            k, best = np.int64(result[2]), result[3]
            winners[0, x], winners[1, x], winners[2, x] = result[2], best, result[4]
            winners[3, x] = sums[k - 1] if k > 0 else best
            winners[4, x] = sums[k + 1] if k < bins - 1 else best
            parity, slot = 1 - parity, slot + stride
        _disparity_row(
            winners, half_bins, uniqueness, agreement_px, cheapest, kept,
            disparity[y], verdict[y], distinctness[y],
        )  # fmt: skip
