"""Runs the aggregation kernels over a pair: descriptors, working memory, one or two threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Literal

import cv2
import numpy as np

from pseudolidar.stereo import sgm_kernels as kernels
from pseudolidar.structures.arrays import AnyArray, Float32, UInt8

_CACHE_LINE = 64
# Value half a pixel to the right: cubic convolution, sixteenths.
_HALF_PIXEL_FILTER = (-1, 9, 9, -1)


@dataclass(frozen=True, eq=False)
class Winners:
    """What aggregation decided, before smoothing.

    Args:
        disparity: (H, W) float32 px, everywhere.
        verdict: (H, W) uint8, `AGREED` by both eyes, `UNIQUE` besides, or 0.
        distinctness: (H, W) float32, (second best sum - best) / (best + 1).
    """

    disparity: Float32
    verdict: UInt8
    distinctness: Float32


def _aligned(bytes_: int) -> UInt8:
    buffer = np.empty(bytes_ + _CACHE_LINE, np.uint8)
    start = -buffer.ctypes.data % _CACHE_LINE
    return buffer[start : start + bytes_]


class PathState:
    """Working memory of one sweep.

    The vertical path of row r lies in `column` from slot H - 1 - r on, one slot to the left of the
    row before: one pixel reads slot i + 1 and writes slot i, so one row of memory serves two.
    """

    def __init__(self, height: int, width: int, bins: int) -> None:
        stride = bins + kernels.GUARD
        self.height, self.bins = height, bins
        self.cost = _aligned(width * bins)
        self.column = _aligned((height + width) * stride + kernels.GUARD)
        self.line = _aligned(2 * stride + kernels.GUARD)
        self.minima = np.empty(width, np.uint8)
        self.sums = _aligned(2 * bins).view(np.uint16)

    def start(self) -> None:
        """Paths start at cost 0; guards cost the most."""
        self.column[:] = 255
        self.line[:] = 255
        self.minima[:] = 0
        slots = self.column[kernels.GUARD :].reshape(-1, self.bins + kernels.GUARD)
        slots[self.height :, : self.bins] = 0

    def arrays(self) -> tuple[AnyArray, ...]:
        """In the order that the kernels take them."""
        return self.cost, self.column, self.line, self.minima, self.sums


class Workspace:
    """Memory for pairs of one size and range: about `H W bins` bytes, reused from frame to frame.

    Args:
        height: rows.
        width: columns.
        disparities: range to search, px.
        half_pixel_range: disparities below it are searched in half pixels.
    """

    def __init__(self, height: int, width: int, disparities: int, half_pixel_range: int) -> None:
        self._key = (height, width, disparities, half_pixel_range)
        self.half_bins = 2 * half_pixel_range
        bins = disparities + half_pixel_range
        self.bins = -(-bins // kernels.LANES) * kernels.LANES
        self.total = _aligned(height * width * self.bins)
        self.states = [PathState(height, width, self.bins)]

    def fits(self, height: int, width: int, disparities: int, half_pixel_range: int) -> bool:
        """Whether it was made for this size and range."""
        return self._key == (height, width, disparities, half_pixel_range)

    def state(self, index: int) -> PathState:
        """State of sweep 0 or 1, ready to start."""
        while len(self.states) <= index:
            self.states.append(PathState(*self._key[:2], self.bins))
        self.states[index].start()
        return self.states[index]


def _census(image: UInt8) -> AnyArray:
    x, y = kernels.CENSUS_RADIUS_X, kernels.CENSUS_RADIUS_Y
    padded = cv2.copyMakeBorder(image, y, y, x, x, cv2.BORDER_REPLICATE)
    descriptors = np.empty(image.shape, np.uint32)
    kernels.census_transform(padded, descriptors)
    return descriptors


def _shifted_half_pixel(image: UInt8) -> UInt8:
    """(H, W): value at x + 1/2."""
    padded = cv2.copyMakeBorder(image, 0, 0, 1, 2, cv2.BORDER_REPLICATE).astype(np.int16)
    width = image.shape[1]
    total = sum(w * padded[:, k : k + width] for k, w in enumerate(_HALF_PIXEL_FILTER))
    return np.clip((total + 8) >> 4, 0, 255).astype(np.uint8)


def _mirrored(descriptors: AnyArray, bins: int) -> AnyArray:
    """Descriptors with x reversed and padded, so that growing disparities run forward in memory."""
    height, width = descriptors.shape
    mirrored = np.zeros((height, width + bins), np.uint32)
    mirrored[:, :width] = descriptors[:, ::-1]
    return mirrored


def _mirrored_halves(right: UInt8, whole: AnyArray, bins: int) -> AnyArray:
    """Descriptors at whole and half pixels interleaved, x reversed."""
    height, width = right.shape
    mirrored = np.zeros((height, 2 * width + bins), np.uint32)
    mirrored[:, 0 : 2 * width : 2] = whole[:, ::-1]
    mirrored[:, 1 : 2 * width - 1 : 2] = _census(_shifted_half_pixel(right))[:, -2::-1]
    return mirrored


def aggregate(
    left: UInt8,
    right: UInt8,
    workspace: Workspace,
    *,
    penalties: tuple[int, int],
    uniqueness: float,
    agreement_px: float,
    threads: Literal[1, 2],
) -> Winners:
    """Disparity of each left pixel by semi-global matching of census descriptors.

    Two threads work from the top and from the bottom to the middle, and then each goes on over the
    other's half: the result is the same bit for bit.

    Args:
        left: (H, W) grey.
        right: (H, W) grey.
        workspace: memory for this size.
        penalties: cost of a step of one bin, and of any larger one.
        uniqueness: share by which the best must beat the second best.
        agreement_px: largest left-right difference.
        threads: 1 or 2.
    """
    bins, half_bins = workspace.bins, workspace.half_bins
    right_words = _census(right)
    whole = _mirrored(right_words, bins)
    halves = _mirrored_halves(right, right_words, bins) if half_bins else whole
    pair = (_census(left), whole, halves, half_bins, bins, penalties)
    shape = left.shape
    found = Winners(
        np.empty(shape, np.float32), np.empty(shape, np.uint8), np.empty(shape, np.float32)
    )
    out = (workspace.total, (uniqueness, agreement_px), *vars(found).values())

    def store(upwards: bool, rows: tuple[int, int], state: PathState) -> None:
        kernels.sweep_and_store(*pair, upwards, rows, state.arrays(), workspace.total)

    def win(upwards: bool, rows: tuple[int, int], state: PathState) -> None:
        kernels.sweep_and_win(*pair, upwards, rows, state.arrays(), *out)

    height = shape[0]
    if threads == 1:
        store(False, (0, height), workspace.state(0))
        win(True, (0, height), workspace.state(0))
    else:
        down, up = workspace.state(0), workspace.state(1)
        middle, rest = height // 2, height - height // 2
        _side_by_side(partial(store, False, (0, middle), down), partial(store, True, (0, rest), up))
        _side_by_side(
            partial(win, False, (middle, height), down), partial(win, True, (rest, height), up)
        )
    return found


def _side_by_side(*calls: Callable[[], None]) -> None:
    with ThreadPoolExecutor(len(calls)) as pool:
        for future in [pool.submit(call) for call in calls]:
            future.result()
