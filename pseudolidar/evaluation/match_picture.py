"""Matches of a pair drawn over its left picture, coloured by how far their rows are off."""

from __future__ import annotations

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.geometry.grey import grey8_left
from pseudolidar.structures.arrays import Bool, Float64, Image, UInt8

# The scale reaches from -this to this at least, px: what a matcher does not mind is grey green.
LEAST_SCALE_PX = 1.0
# Left of the scale, px; height of the strip that holds it.
STRIP_PX, BAR_PX = 34, 240
NARROWEST_PX = 640
# Row differences: blue higher, white none, red lower.
LOW, MIDDLE, HIGH = (40, 110, 255), (240, 240, 240), (255, 60, 40)


def match_picture(
    left: Image, right: Image, left_px: Float64, right_px: Float64, inliers: Bool, *, title: str
) -> UInt8:
    """(H, W, 3) RGB: each match as a dot, with a line to where it is in the right picture.

    Args:
        left: the left picture.
        right: the right one, for the brightness of both.
        left_px: (N, 2) points in the left picture.
        right_px: (N, 2) the same in the right one.
        inliers: (N,) matches that agree; the others are hollow.
        title: what is written above.
    """
    import cv2

    grey = grey8_left(left, right)
    zoom = max(1, -(-NARROWEST_PX // grey.shape[1]))
    grey = np.repeat(np.repeat(grey, zoom, 0), zoom, 1)
    picture = np.repeat((grey // 2)[..., None], 3, axis=2)
    rows_px = right_px[:, 1] - left_px[:, 1]
    limit_px = LEAST_SCALE_PX
    if inliers.any():
        limit_px = max(limit_px, float(np.quantile(np.abs(rows_px[inliers]), 0.95)))
    colours = row_colours(rows_px, limit_px)
    for start, end, colour, fine in zip(left_px, right_px, colours, inliers, strict=True):
        at = tuple(round(zoom * float(value)) for value in start)
        to = tuple(round(zoom * float(value)) for value in end)
        ink = tuple(int(part) for part in colour)
        if fine:
            cv2.line(picture, at, to, ink, 1, cv2.LINE_AA)
        cv2.circle(picture, at, 3, ink, -1 if fine else 1, cv2.LINE_AA)
    return np.vstack([_strip(picture.shape[1], limit_px, title), picture])


def row_colours(rows_px: Float64, limit_px: float) -> UInt8:
    """(N, 3) RGB: white at 0, blue at `-limit_px` (higher in the right picture), red at the other.

    Args:
        rows_px: (N,) y_right - y_left.
        limit_px: where colours are full.
    """
    share = np.clip(np.asarray(rows_px) / limit_px, -1, 1)[:, None]
    ends = np.where(share < 0, np.array(LOW), np.array(HIGH))
    mixed = (1 - np.abs(share)) * np.array(MIDDLE) + np.abs(share) * ends
    return np.asarray(np.rint(mixed), np.uint8)


def _strip(width: int, limit_px: float, title: str) -> UInt8:
    strip = np.full((STRIP_PX, width, 3), 24, np.uint8)
    bar = row_colours(np.linspace(-limit_px, limit_px, BAR_PX), limit_px)
    begin = width - BAR_PX - 60
    strip[12:22, begin : begin + BAR_PX] = bar[None]
    write_on(strip, title, (8, 22))
    write_on(strip, f"{-limit_px:.1f}", (begin - 40, 22))
    write_on(strip, f"{limit_px:+.1f} px", (begin + BAR_PX + 4, 22))
    return strip
