"""How much two detections have in common."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.box import Detection

BoxPx = tuple[float, float, float, float]


def box_iou(a: BoxPx, b: BoxPx) -> float:
    """Intersection over union of two boxes whose edges are centres of pixels."""
    width = min(a[2], b[2]) - max(a[0], b[0]) + 1
    height = min(a[3], b[3]) - max(a[1], b[1]) + 1
    if width <= 0 or height <= 0:
        return 0.0
    return width * height / (_area(a) + _area(b) - width * height)


def agreement(a: Detection, b: Detection) -> float:
    """Intersection over union of their boxes, or of their masks if that is more."""
    of_boxes = box_iou(a.box_px, b.box_px)
    if a.mask is None or b.mask is None or not of_boxes:
        return of_boxes
    both = int(np.count_nonzero(a.mask & b.mask))
    either = int(np.count_nonzero(a.mask | b.mask))
    return max(of_boxes, both / max(1, either))


def _area(box: BoxPx) -> float:
    return (box[2] - box[0] + 1) * (box[3] - box[1] + 1)
