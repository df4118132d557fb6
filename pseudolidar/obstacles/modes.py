"""Depth modes: the surfaces one behind the other that a frustum sees."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pseudolidar.structures.arrays import Float64

# Depths nearer to each other than this are of one surface, however exact they are, m.
ALIKE_M = 0.3
# Bins of the density, and its smoothing, in steps of what can be told apart.
BIN, SMOOTHING = 0.5, 1.0
# Two peaks are two modes where the valley between them is lower than this share of the lower one.
VALLEY = 0.5
# Modes of less than this share of the weight are noise.
LEAST_SHARE = 0.02
TABLE = 1000


@dataclass(frozen=True)
class Mode:
    """A range of depths with much in it.

    Args:
        from_m: where it begins.
        to_m: where it ends.
        weight: sum of the weights of its pixels.
    """

    from_m: float
    to_m: float
    weight: float


def depth_modes(depth_m: Float64, weight: Float64, per_depth_squared: float) -> tuple[Mode, ...]:
    """Modes of depths, the nearest first.

    Depths are counted in steps of what can be told apart: 0.3 m near the camera, one sigma far
    away, so that one surface is one peak at any distance.

    Args:
        depth_m: (N,) Z, N > 0.
        weight: (N,).
        per_depth_squared: sigma of depths over their square, 1/m.
    """
    table_m = np.geomspace(0.9 * depth_m.min(), 1.1 * depth_m.max(), TABLE)
    per_m = 1.0 / np.hypot(ALIKE_M, per_depth_squared * table_m**2)
    steps = np.concatenate([[0.0], np.cumsum(0.5 * (per_m[1:] + per_m[:-1]) * np.diff(table_m))])
    margin = int(3 * SMOOTHING / BIN)
    bins = (np.interp(depth_m, table_m, steps) / BIN).astype(int) + margin
    counts = np.bincount(bins, weights=weight, minlength=int(bins.max()) + margin + 2)
    kernel = np.exp(-0.5 * (np.arange(-margin, margin + 1) * BIN / SMOOTHING) ** 2)
    density = np.convolve(counts, kernel / kernel.sum(), "same")
    edges = _edges(density)
    edges_m = np.interp((np.array(edges) - margin) * BIN, steps, table_m)
    of_mode = np.searchsorted(edges[1:-1], bins, side="right")
    weights = np.bincount(of_mode, weights=weight, minlength=len(edges) - 1)
    least = LEAST_SHARE * float(weight.sum())
    return tuple(
        Mode(float(low), float(high), float(w))
        for low, high, w in zip(edges_m, edges_m[1:], weights, strict=False)
        if w > least
    )


def _edges(density: Float64) -> list[int]:
    """Bins where modes begin and end: valleys that are low enough, and both ends."""
    last = len(density) - 1
    peaks = [i for i in range(1, last) if density[i - 1] <= density[i] > density[i + 1]]
    valleys = [a + int(np.argmin(density[a : b + 1])) for a, b in pairwise(peaks)]
    heights = [float(density[p]) for p in peaks]
    while valleys:
        ratios = [density[v] / min(heights[i : i + 2]) for i, v in enumerate(valleys)]
        worst = int(np.argmax(ratios))
        if ratios[worst] < VALLEY:
            break
        del valleys[worst]
        heights[worst : worst + 2] = [max(heights[worst : worst + 2])]
    return [0, *valleys, last]
