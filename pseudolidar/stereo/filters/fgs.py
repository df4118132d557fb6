"""Fast global smoothing of values, guided by a picture, weighed by confidence, true to slopes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pseudolidar.stereo.filters import fgs_kernels as kernels
from pseudolidar.structures.arrays import Float32, UInt8

# Passes over rows and columns, and by how much each smooths less than the one before.
# Source: Min et al. 2014, section III-B; T = 3 is the paper's.
ITERATIONS, ATTENUATION = 3, 4.0
LARGEST_STEP = 255
# A steeper slope is a step between surfaces, px of disparity a pixel: the road before the wheels of
# a car has 0.4.
LARGEST_SLOPE = 1.0
# Slopes are as smooth as surfaces are: half the resolution is enough, at a quarter of the time.
SLOPE_SCALE = 2
NOTHING = np.float32(1e-20)  # confidence below which there is none


@dataclass(frozen=True, eq=False)
class Links:
    """How strongly neighbouring pixels of a picture are tied: exp(-|I_p - I_q| / sigma_color).

    Args:
        down: (H, W) to the pixel below, last row 0.
        right: (W, H) transposed, to the pixel on the right, last row 0.
    """

    down: Float32
    right: Float32

    @classmethod
    def of(cls, guide: UInt8, sigma_color: float) -> Links:
        """The links of a picture (H, W, C)."""
        height, width, channels = guide.shape
        squared = np.arange(channels * LARGEST_STEP**2 + 1, dtype=np.float32)
        table = np.exp(-np.sqrt(squared) / np.float32(sigma_color))
        links = cls(np.empty((height, width), np.float32), np.empty((width, height), np.float32))
        kernels.edge_weights(guide, table, links.down, links.right)
        return links

    def smooth(
        self, maps: Float32, *, strength: float, rise: tuple[Float32, Float32] | None = None
    ) -> Float32:
        """Smooth (K, H, W) maps by alternating solves along rows and columns.

        Args:
            maps: values times confidence, the confidence itself last.
            strength: lambda.
            rise: (W, H) and (H, W): by how much a surface rises along each row (transposed) and
                down each column, from its first pixel on; deviations from it are what is smoothed.

        Source: Min et al. 2014, equations 8-10 (separable solves), 12 (lambda of each pass).
        """
        along_rows, down_columns = np.empty_like(self.right), np.empty_like(self.down)
        share = 1.5 * strength / (ATTENUATION**ITERATIONS - 1)
        for iteration in range(ITERATIONS):
            lam = share * ATTENUATION ** (ITERATIONS - 1 - iteration)
            maps = _turned(maps)
            _solve(self.right, lam, maps, along_rows, None if rise is None else rise[0])
            maps = _turned(maps)
            _solve(self.down, lam, maps, down_columns, None if rise is None else rise[1])
        return maps


def _turned(maps: Float32) -> Float32:
    turned = np.empty((len(maps), maps.shape[2], maps.shape[1]), np.float32)
    for k, one in enumerate(maps):
        cv2.transpose(one, dst=turned[k])
    return turned


def _solve(
    weights: Float32, lam: float, maps: Float32, memory: Float32, rise: Float32 | None
) -> None:
    if rise is not None:
        maps[0] -= maps[-1] * rise
    kernels.solve_columns(weights, lam, maps, memory)
    if rise is not None:
        maps[0] += maps[-1] * rise


def smooth_surfaces(
    values: Float32,
    confidence: Float32,
    guide: UInt8,
    *others: Float32,
    strength: float,
    sigma_color: float,
) -> tuple[Float32, ...]:
    """Smooth `values` where the picture is smooth, trusting each by its confidence.

    Minimises sum_p c_p (u_p - f_p)^2 + strength sum_pq w_pq (u_q - u_p - s_pq)^2 over neighbours
    p, q. Without the slopes s the smoother pulls every slanted surface flat: on KITTI it then
    loses more by its bias than it gains. They are found first, by smoothing the slopes of `values`
    in the same way.

    Args:
        values: (H, W) float32, any number where the confidence is 0.
        confidence: (H, W) float32, 0 where there is no value, 1 at most.
        guide: (H, W, C) picture.
        others: (H, W) float32 that are smoothed alike, but as what has no slope.
        strength: lambda; larger reaches farther.
        sigma_color: difference of colours, in grey levels, that counts as an edge.

    Returns:
        (H, W) float32 of `values` and of each of the others; NaN where no value reaches.

    Source: Min, Choi, Lu, Ham, Sohn, Do, Fast Global Image Smoothing Based on Weighted Least
        Squares, IEEE TIP 23(12), 2014; confidence as in its section IV-B. The slopes are ours.
    """
    known = confidence > 0
    weighed = [np.where(known, one, np.float32(0)) for one in (values, *others)]
    along_x, along_y = _slopes(weighed[0], confidence, guide, strength, sigma_color)
    rise_x = np.cumsum(cv2.transpose(along_x), axis=0, dtype=np.float32)
    rise_y = np.cumsum(along_y, axis=0, dtype=np.float32)
    links = Links.of(guide, sigma_color)
    maps = np.stack([*(one * confidence for one in weighed), confidence])
    *smoothed, support = links.smooth(maps, strength=strength, rise=(rise_x, rise_y))
    support[support < NOTHING] = np.nan
    return tuple(one / support for one in smoothed)


def _slopes(
    values: Float32, confidence: Float32, guide: UInt8, strength: float, sigma_color: float
) -> tuple[Float32, Float32]:
    """(H, W) rise from the pixel on the left, and from the one above."""
    height, width = values.shape
    raw = np.empty((3, height, width), np.float32)
    kernels.weighed_slopes(values, confidence, LARGEST_SLOPE, raw)
    small = -(-width // SLOPE_SCALE), -(-height // SLOPE_SCALE)
    halves = [cv2.resize(one, small, interpolation=cv2.INTER_AREA) for one in raw]
    maps = np.stack(halves).astype(np.float32, copy=False)
    half_guide = cv2.resize(guide, small, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    links = Links.of(half_guide.reshape(small[1], small[0], -1), sigma_color)
    maps = links.smooth(maps, strength=strength / SLOPE_SCALE**2)
    support = np.maximum(maps[2], NOTHING)
    along_x, along_y = (
        cv2.resize(one / support, (width, height), interpolation=cv2.INTER_LINEAR)
        for one in maps[:2]
    )
    return np.asarray(along_x, np.float32), np.asarray(along_y, np.float32)
