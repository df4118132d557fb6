"""Boxes as lines: whole where they are sure, dashed where they are not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.structures.box import BOX_EDGES

# viser takes colours of lines for light, not for what a screen is sent: without this they are pale.
SCREEN_GAMMA = 2.2
# Dashes of an edge, whatever its length.
DASHES = 7
# A cross at a place, m.
CROSS_M = 0.4
_EDGES = np.array(BOX_EDGES)


def edges_of(boxes: Sequence[Float64]) -> Float32:
    """(12 N, 2, 3) edges of N boxes, each given by its (8, 3) corners."""
    if not boxes:
        return np.zeros((0, 2, 3), np.float32)
    return np.concatenate([corners[_EDGES] for corners in boxes]).astype(np.float32)


def dashed(edges: Float32) -> Float32:
    """(N * DASHES, 2, 3) dashes of (N, 2, 3) edges, whole at both ends."""
    ends = np.linspace(0.0, 1.0, 2 * DASHES).reshape(DASHES, 2)
    begin, end = edges[:, None, None, 0], edges[:, None, None, 1]
    parts = begin + ends[None, :, :, None] * (end - begin)
    return np.asarray(parts.reshape(-1, 2, 3), np.float32)


def cross(place_m: Float64) -> Float32:
    """(3, 2, 3) a cross at a place (3,)."""
    arms = np.eye(3) * (0.5 * CROSS_M)
    return np.asarray(np.stack([place_m - arms, place_m + arms], axis=1), np.float32)


def coloured(colours: Sequence[tuple[int, int, int]], each: int) -> UInt8:
    """(N * each, 2, 3) lines of each of these colours of the screen, so many of each."""
    light = 255.0 * (np.array(colours, np.float64).reshape(-1, 1, 1, 3) / 255.0) ** SCREEN_GAMMA
    rows = np.rint(light).astype(np.uint8)
    return np.asarray(np.broadcast_to(rows, (len(colours), each, 2, 3)).reshape(-1, 2, 3))
