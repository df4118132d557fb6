"""Pixels that touch and have much the same depth, numbered."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Bool, Float32, Int64


def connected(inside: Bool, depth: Float32, step: Float32) -> Int64:
    """(H, W) number of the connected pixels each belongs to, from 1; 0 is outside.

    Neighbours are linked, across and down, where their depths differ by no more than a step: in a
    picture of double size with a pixel for each link, connected components do the rest.

    Args:
        inside: (H, W) pixels that count.
        depth: (H, W) m.
        step: (H, W) largest difference to a neighbour, m.
    """
    import cv2

    height, width = inside.shape
    links = np.zeros((2 * height - 1, 2 * width - 1), np.uint8)
    links[::2, ::2] = inside
    near = np.abs(np.diff(depth, axis=1)) <= step[:, 1:]
    links[::2, 1::2] = near & inside[:, 1:] & inside[:, :-1]
    near = np.abs(np.diff(depth, axis=0)) <= step[1:]
    links[1::2, ::2] = near & inside[1:] & inside[:-1]
    _, numbers = cv2.connectedComponents(links, connectivity=4)
    return numbers[::2, ::2].astype(np.int64)
