"""Points followed from one picture to another, to a fraction of a pixel."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Bool, Float32, UInt8

ITERATIONS, CONVERGED_PX = 30, 0.01
# Smallest eigenvalue of a window that can be followed, in OpenCV's unit.
MIN_EIGENVALUE = 1e-4
# A point's whole window should be in the picture, px from the border.
BORDER_PX = 3


def follow(
    source: UInt8,
    target: UInt8,
    uv: Float32,
    guess: Float32,
    *,
    window_px: int,
    levels: int = 0,
    iterations: int = ITERATIONS,
) -> tuple[Float32, Bool]:
    """Where points of one picture are in another, by pyramidal Lucas-Kanade.

    Args:
        source: (H, W) grey.
        target: (H, W) grey.
        uv: (N, 2) px in `source`.
        guess: (N, 2) px in `target`, where the search starts.
        window_px: side of the window that is compared.
        levels: halvings of the picture, for guesses far off.
        iterations: on each of them at most.

    Returns:
        (N, 2) px in `target`, and (N,) which were found inside it.

    Source: Bouguet, Pyramidal Implementation of the Affine Lucas Kanade Feature Tracker, 2001.
    """
    import cv2

    if not len(uv):
        return uv.copy(), np.zeros(0, np.bool_)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, iterations, CONVERGED_PX)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        uv.astype(np.float32),
        guess.astype(np.float32).copy(),
        winSize=(window_px, window_px),
        maxLevel=levels,
        criteria=criteria,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=MIN_EIGENVALUE,
    )
    height, width = target.shape
    inside = np.all(
        (found > BORDER_PX) & (found < (width - 1 - BORDER_PX, height - 1 - BORDER_PX)), axis=1
    )
    return np.asarray(found, np.float32), (status.ravel() > 0) & inside


def follow_both_ways(
    source: UInt8,
    target: UInt8,
    uv: Float32,
    guess: Float32,
    *,
    window_px: int,
    levels: int = 0,
    within_px: float,
    iterations: int = ITERATIONS,
) -> tuple[Float32, Bool]:
    """As `follow`; only points that come back to `within_px` of where they started."""
    there, found = follow(
        source, target, uv, guess, window_px=window_px, levels=levels, iterations=iterations
    )
    start = uv[found]
    back, returned = follow(
        target,
        source,
        there[found],
        there[found] - (guess[found] - start),
        window_px=window_px,
        levels=levels,
        iterations=iterations,
    )
    found[found] = returned & (np.linalg.norm(back - start, axis=1) < within_px)
    return there, found
