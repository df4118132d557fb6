"""Of several boxes around one object, the best."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Bool, Float64, Int64

# So many boxes are looked at, the best first: a network that is sure of more is sure of nothing.
MOST_BOXES = 3000
# Boxes that are as good as the same are of one object, whatever their classes: a bicycle that looks
# like a motorbike, too.
ONE_THING = 0.85


def in_order(boxes: Float64, scores: Float64, labels: Int64) -> Int64:
    """Positions from the best score down; equal ones by class and place, so that it is settled."""
    keys = (boxes[:, 3], boxes[:, 2], boxes[:, 1], boxes[:, 0], labels, -scores)
    return np.asarray(np.lexsort(keys)[:MOST_BOXES], np.int64)


def best_boxes(
    boxes: Float64,
    scores: Float64,
    labels: Int64,
    *,
    overlap: float,
    parts: Int64 | None = None,
    inside: float = 1.0,
) -> Int64:
    """Positions of the boxes that no better one of their class overlaps, the best first.

    Boxes of other classes go only where they are as good as the same.

    Args:
        boxes: (N, 4) left, top, right, bottom, px.
        scores: (N,) 0-1.
        labels: (N,) classes.
        overlap: intersection over union above which two boxes are of one object.
        parts: (N,) the crop of the picture that each was found in, or None.
        inside: share of the smaller box above which two of different crops are of one object.
    """
    left = in_order(boxes, scores, labels)
    chosen: list[int] = []
    while left.size:
        best, rest = int(left[0]), left[1:]
        chosen.append(best)
        same = _same_object(boxes, best, rest, overlap)
        if parts is not None:
            contained = _shared(boxes, best, rest, "smaller") > inside
            same |= contained & (parts[rest] != parts[best])
        same &= labels[rest] == labels[best]
        left = rest[~(same | _same_object(boxes, best, rest, ONE_THING))]
    return np.array(chosen, np.int64)


def _same_object(boxes: Float64, one: int, others: Int64, overlap: float) -> Bool:
    return np.asarray(_shared(boxes, one, others, "union") > overlap)


def _shared(boxes: Float64, one: int, others: Int64, of: str) -> Float64:
    """(M,) intersection over the union, or over the smaller of the two."""
    low = np.maximum(boxes[one, :2], boxes[others, :2])
    high = np.minimum(boxes[one, 2:], boxes[others, 2:])
    common = np.prod(np.maximum(high - low, 0), axis=1)
    area = np.prod(boxes[others, 2:] - boxes[others, :2], axis=1)
    own = float(np.prod(boxes[one, 2:] - boxes[one, :2]))
    whole = own + area - common if of == "union" else np.minimum(own, area)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(whole > 0, common / whole, 0.0), np.float64)
