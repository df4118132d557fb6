"""Objects of all parts of a picture, each once, and only those that can be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ModelOutput
from pseudolidar.obstacles.networks.answer import Candidates
from pseudolidar.obstacles.networks.class_names import ClassNames
from pseudolidar.obstacles.networks.letterbox import Placement
from pseudolidar.obstacles.networks.masks import mask_in_picture
from pseudolidar.obstacles.networks.nms import best_boxes, in_order
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.box import Detection
from pseudolidar.structures.image_size import ImageSize

# An object of a tile this much inside one of another part is the same.
_INSIDE = 0.8
# A network may put centres beyond its input by this share of it, and no farther.
_BEYOND_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class PartFound:
    """Objects in one part of a picture.

    Args:
        candidates: as the network has them.
        boxes: (N, 4) the same in picture coordinates, not clipped.
        place: of the part in the network's input.
        size: of the input.
    """

    candidates: Candidates
    boxes: Float64
    place: Placement
    size: ImageSize

    def mask(self, index: int, picture: tuple[int, int]) -> Bool | None:
        """(H, W) pixels of one of the objects, None where it has none."""
        masks = self.candidates.masks
        if masks is None:
            return None
        box = self.boxes[index]
        return mask_in_picture(masks, index, box, self.place, self.size, picture)


def merged(
    found: list[PartFound], picture: tuple[int, int], names: ClassNames, *, overlap: float
) -> tuple[Detection, ...]:
    """The objects of a picture, the surest first, clipped to it.

    Args:
        found: in each part of it.
        picture: (height, width) px.
        names: of the classes.
        overlap: intersection over union above which two boxes of a class are one object.
    """
    boxes = np.concatenate([f.boxes for f in found])
    scores = np.concatenate([f.candidates.scores for f in found])
    labels = np.concatenate([f.candidates.labels for f in found])
    parts = np.repeat(np.arange(len(found)), [len(f.boxes) for f in found])
    within = np.concatenate([np.arange(len(f.boxes)) for f in found])
    order = in_order(boxes, scores, labels)
    if len(found) > 1:
        order = best_boxes(boxes, scores, labels, overlap=overlap, parts=parts, inside=_INSIDE)
    detections = []
    for i in order:
        clipped = _clipped(boxes[i], picture)
        if clipped is not None:
            mask = found[parts[i]].mask(int(within[i]), picture)
            score = float(np.clip(scores[i], 0, 1))
            detections.append(Detection(names[int(labels[i])], clipped, score, mask))
    return tuple(detections)


def check_inside(found: Candidates, size: ImageSize) -> None:
    """Refuse boxes that no detector would answer with.

    Raises:
        ModelOutput: NaN, a negative size, or a centre outside of the input.
    """
    boxes = found.boxes
    if not len(boxes):
        return
    finite = np.isfinite(boxes).all(axis=1)
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2 / np.array([size.width, size.height])
    with np.errstate(invalid="ignore"):
        inside = np.all((centres > -_BEYOND_SHARE) & (centres < 1 + _BEYOND_SHARE), axis=1)
        upright = np.all(boxes[:, 2:] >= boxes[:, :2], axis=1)
    bad = np.flatnonzero(~(finite & inside & upright))
    if len(bad):
        box = ", ".join(f"{value:.4g}" for value in boxes[bad[0]])
        raise ModelOutput(
            f"{len(bad)} of {len(boxes)} boxes are none in the picture, such as {box} with score "
            f"{found.scores[bad[0]]:.2f}",
            want=f"left, top, right, bottom within an input of {size}",
            fix="Its layout is another one: pass --detector.layout.family, "
            "--detector.layout.boxes.",
        )


def _clipped(box: Float64, picture: tuple[int, int]) -> tuple[float, float, float, float] | None:
    """The part of a box inside the picture; None where it lies beside it."""
    height, width = picture
    left, right = (float(min(max(x, 0.0), width - 1)) for x in box[[0, 2]])
    top, bottom = (float(min(max(y, 0.0), height - 1)) for y in box[[1, 3]])
    return None if right <= left or bottom <= top else (left, top, right, bottom)
