"""Edges of a thing of one colour to parts of a pixel, by how its rim mixes with what is behind."""

from __future__ import annotations

import numpy as np

from pseudolidar.obstacles.spots import Spot
from pseudolidar.structures.arrays import Bool, Float32, Float64, Int64

# The thing and what is behind it are looked at this far inside and outside of an edge, px.
BESIDE_PX = 2
# A difference of colours less than this (0-1) tells nothing about mixtures.
LEAST_CONTRAST = 0.08


def edges_px(mask: Bool, spot: Spot, rgb: Float32) -> tuple[float, float, float, float]:
    """Left, top, right, bottom: where coverage ends, within the picture.

    Where a pixel is covered by half, an edge runs through its middle. A line across an edge holds
    as much of the thing's colour as its pixels are covered.

    Args:
        mask: (H, W) pixels of the thing.
        spot: its window.
        rgb: (H, W, 3) colours, 0-1.
    """
    window = spot.rows, spot.columns
    left = _first(mask, rgb, window)
    right = mask.shape[1] - 1 - _first(mask[:, ::-1], rgb[:, ::-1], _mirrored(window, mask.shape))
    top_down = (spot.columns, spot.rows)
    mask, rgb = mask.T, rgb.transpose(1, 0, 2)
    top = _first(mask, rgb, top_down)
    last = _first(mask[:, ::-1], rgb[:, ::-1], _mirrored(top_down, mask.shape))
    bottom = mask.shape[1] - 1 - last
    return left, top, max(left, right), max(top, bottom)


def _mirrored(window: tuple[slice, slice], shape: tuple[int, ...]) -> tuple[slice, slice]:
    rows, columns = window
    return rows, slice(shape[1] - columns.stop, shape[1] - columns.start)


def _first(mask: Bool, rgb: Float32, window: tuple[slice, slice]) -> float:
    """Where the thing begins, seen from the left."""
    rows = np.arange(window[0].start, window[0].stop)
    rows = rows[mask[rows].any(axis=1)]
    starts = np.argmax(mask[rows], axis=1)
    # Rows whose start is not that of their neighbours too are stray pixels.
    smooth = np.median(np.stack([np.roll(starts, k) for k in (-1, 0, 1)]), axis=0)
    if len(starts) >= 3:
        smooth[[0, -1]] = starts[[0, -1]]
    else:
        smooth = starts
    near = smooth <= smooth.min()
    begins = _begins(rgb, rows[near], smooth[near].astype(np.int64))
    return float(np.clip(np.median(begins), 0, mask.shape[1] - 1))


def _begins(rgb: Float32, rows: Int64, starts: Int64) -> Float64:
    """Where coverage begins in each row, given the first pixel that counts as covered."""
    width = rgb.shape[1]
    outside, inside = starts - BESIDE_PX, starts + BESIDE_PX
    usable = (outside >= 0) & (inside < width)
    result = starts - 0.5
    rows, starts = rows[usable], starts[usable]
    thing, behind = rgb[rows, inside[usable]], rgb[rows, outside[usable]]
    difference = thing - behind
    contrast = np.einsum("ij,ij->i", difference, difference)
    covered = np.zeros(len(rows))
    for offset in range(1 - BESIDE_PX, BESIDE_PX):
        mixed = rgb[rows, starts + offset] - behind
        share = np.einsum("ij,ij->i", mixed, difference) / np.maximum(contrast, 1e-9)
        covered += np.clip(share, 0, 1)
    begins = inside[usable] - 0.5 - covered
    told = contrast >= LEAST_CONTRAST**2
    result[usable] = np.where(told, begins, starts - 0.5)
    return np.asarray(result, np.float64)
