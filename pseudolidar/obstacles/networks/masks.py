"""Masks of a network's objects in the picture."""

from __future__ import annotations

import numpy as np

from pseudolidar.obstacles.networks.answer import CandidateMasks
from pseudolidar.obstacles.networks.letterbox import Placement
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.image_size import ImageSize


def mask_in_picture(
    masks: CandidateMasks,
    index: int,
    box: Float64,
    place: Placement,
    size: ImageSize,
    picture: tuple[int, int],
) -> Bool | None:
    """(H, W) the pixels of an object inside its box; None where the mask has none of them.

    Each pixel of the box looks up its place in the network's mask, linearly between its pixels.

    Args:
        masks: as the network has them.
        index: of the object.
        box: (4,) of the object in picture coordinates, not clipped.
        place: of the picture, or the part of it that was looked at, in the input.
        size: of the input.
        picture: (height, width) px.
    """
    import cv2

    plane = masks.plane(index)
    height, width = picture
    left, top = (max(0, int(np.ceil(value))) for value in box[:2])
    right, bottom = (
        min(int(np.floor(value)), most - 1)
        for value, most in zip(box[2:], (width, height), strict=True)
    )
    if right < left or bottom < top:
        return None
    x, y = (
        np.arange(left, right + 1, dtype=np.float64),
        np.arange(top, bottom + 1, dtype=np.float64),
    )
    if masks.in_box:
        u = (x - box[0]) / (box[2] - box[0]) * plane.shape[1] - 0.5
        v = (y - box[1]) / (box[3] - box[1]) * plane.shape[0] - 0.5
    else:
        u = ((x - place.origin[0] + 0.5) * place.scale[0] + place.offset[0]) * (
            plane.shape[1] / size.width
        ) - 0.5
        v = ((y - place.origin[1] + 0.5) * place.scale[1] + place.offset[1]) * (
            plane.shape[0] / size.height
        ) - 0.5
    columns, rows = np.meshgrid(u.astype(np.float32), v.astype(np.float32))
    values = cv2.remap(plane, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    found = np.zeros(picture, np.bool_)
    found[top : bottom + 1, left : right + 1] = values > masks.level
    return found if found.any() else None
