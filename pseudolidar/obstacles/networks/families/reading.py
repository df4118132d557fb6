"""What families of detectors have in common: lists of boxes, and what can be scores and labels."""

from __future__ import annotations

import numpy as np

from pseudolidar.errors import ModelOutput
from pseudolidar.obstacles.networks.answer import Answer, CandidateMasks, Candidates, in_pixels
from pseudolidar.obstacles.networks.layout import BoxUnit, DetectorLayout
from pseudolidar.structures.arrays import AnyArray, Int64

# Shares of the input exceed 1 by little, pixels by much.
_LARGEST_SHARE = 1.5
# 16-bit networks miss 0 and 1 by this.
_SLACK = 1e-3

LETTERBOXED = DetectorLayout(
    normalisation="unit", channels="rgb", fit="centre", fill=114, boxes="pixel", first_label=0
)


def listed(
    answer: Answer,
    layout: DetectorLayout,
    boxes: AnyArray,
    scores: AnyArray,
    labels: AnyArray,
    found: Int64,
    masks: CandidateMasks | None = None,
) -> Candidates:
    """The candidates at some positions of lists; `masks` are those of these positions."""
    numbers = labels[found]
    if not are_labels(numbers):
        raise ModelOutput(f"labels {numbers[:5].tolist()}", want="whole numbers from 0")
    return Candidates(
        in_pixels(np.asarray(boxes[found], np.float64), layout.boxes, answer.size),
        np.asarray(scores[found], np.float64),
        np.asarray(np.rint(numbers), np.int64),
        masks,
    )


def box_unit(boxes: AnyArray) -> BoxUnit:
    """Pixels, unless all are shares; of no boxes pixels too."""
    shares = boxes.size > 0 and bool(np.any(boxes > 0)) and bool(np.all(boxes <= _LARGEST_SHARE))
    return "share" if shares else "pixel"


def are_scores(values: AnyArray) -> bool:
    """Whether all are 0-1; of none True."""
    return not values.size or bool(values.min() >= -_SLACK and values.max() <= 1 + _SLACK)


def are_labels(values: AnyArray) -> bool:
    """Whether all are whole numbers from 0; of none True."""
    return not values.size or bool(values.min() >= 0 and np.all(values == np.rint(values)))


def unread(answer: Answer, form: str) -> ModelOutput:
    """The error of outputs that are not of the family."""
    return ModelOutput(f"outputs {answer}", want=form)
