"""Detectors whose outputs are lists by name: labels, boxes, scores; dets, labels; TF-OD's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.networks.answer import Answer, CandidateMasks, Candidates, kept
from pseudolidar.obstacles.networks.families.reading import box_unit, listed, unread
from pseudolidar.obstacles.networks.layout import DetectorLayout, FamilyName
from pseudolidar.structures.arrays import Int64

_EVEN = 0.5  # probability above which a pixel is of an object


@dataclass(frozen=True)
class LabelsBoxesScores:
    """`labels`, `boxes`, `scores`: RT-DETR, D-FINE, torchvision; `det_boxes` and so on."""

    name: FamilyName = "labels-boxes-scores"
    form: str = "outputs named labels (or classes), boxes and scores, one entry a box"
    overlapping: bool = False

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By names. Without a batch it is of torchvision: labels from 1, at the picture's size."""
        boxes = answer.named("box")
        labels, scores = answer.named("label", "class"), answer.named("score")
        if boxes is None or labels is None or scores is None or boxes.shape[-1] != 4:
            return None
        if boxes.size // 4 != labels.size or labels.size != scores.size:
            return None
        single = boxes.ndim == 2
        return DetectorLayout(
            family=self.name,
            normalisation="unit",
            channels="rgb",
            fit="as-is" if single else "stretch",
            fill=114,
            boxes=box_unit(boxes.reshape(-1, 4)),
            classes=known.classes,
            first_label=1 if single else 0,
            batch=1 if single else None,
        )

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """Entries with the scores that are asked for; no more than a count among the outputs."""
        boxes = answer.named("box")
        labels, scores = answer.named("label", "class"), answer.named("score")
        if boxes is None or labels is None or scores is None:
            raise unread(answer, self.form)
        found = kept(scores.ravel(), threshold)
        if (count := answer.named("num")) is not None and count.size == 1:
            found = found[found < int(count.ravel()[0])]
        masks = _listed_masks(answer, found)
        flat = boxes.reshape(-1, 4)
        return listed(answer, layout, flat, scores.ravel(), labels.ravel(), found, masks)


@dataclass(frozen=True)
class DetsLabels:
    """`dets` (1, N, 5) corners and score, `labels` (1, N), `masks` (1, N, h, w): MMDetection."""

    name: FamilyName = "dets-labels"
    form: str = "outputs dets (1, boxes, 5) and labels (1, boxes)"
    overlapping: bool = False

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By names and five columns."""
        rows, labels = answer.named("det", "box"), answer.named("label", "class")
        if rows is None or labels is None or rows.shape[-1] != 5 or rows.size != 5 * labels.size:
            return None
        return DetectorLayout(
            family=self.name,
            normalisation="imagenet",
            channels="rgb",
            fit="corner",
            fill=0,
            boxes=box_unit(rows.reshape(-1, 5)[:, :4]),
            classes=known.classes,
            first_label=0,
        )

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """Rows with the scores that are asked for; labels of -1 fill up."""
        rows, labels = answer.named("det", "box"), answer.named("label", "class")
        if rows is None or labels is None:
            raise unread(answer, self.form)
        flat = rows.reshape(-1, 5)
        found = kept(flat[:, 4], threshold)
        found = found[labels.ravel()[found] >= 0]
        masks = _listed_masks(answer, found)
        return listed(answer, layout, flat[:, :4], flat[:, 4], labels.ravel(), found, masks)


@dataclass(frozen=True)
class TfOd:
    """`detection_boxes` (top, left, bottom, right, shares), `_classes`, `_scores`, `num_...`."""

    name: FamilyName = "tf-od"
    form: str = "outputs detection_boxes, detection_classes, detection_scores, num_detections"
    overlapping: bool = False

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By names; the network brings pictures to its size by itself."""
        needed = ("detection_boxes", "detection_classes", "detection_scores")
        arrays = [answer.named(name) for name in needed]
        if any(array is None for array in arrays):
            return None
        return DetectorLayout(
            family=self.name,
            normalisation="raw",
            channels="rgb",
            fit="as-is",
            fill=0,
            boxes="share",
            classes=known.classes,
            first_label=1,
        )

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """Entries with the scores that are asked for, no more than their count."""
        boxes, scores = answer.named("detection_boxes"), answer.named("detection_scores")
        labels = answer.named("detection_classes")
        if boxes is None or scores is None or labels is None:
            raise unread(answer, self.form)
        found = kept(scores.ravel(), threshold)
        if (count := answer.named("num_detections")) is not None:
            found = found[found < int(count.ravel()[0])]
        masks = _listed_masks(answer, found, in_box=True)
        flat = boxes.reshape(-1, 4)[:, [1, 0, 3, 2]]
        return listed(answer, layout, flat, scores.ravel(), labels.ravel(), found, masks)


def _listed_masks(
    answer: Answer, found: Int64, *, in_box: bool | None = None
) -> CandidateMasks | None:
    """Masks (1, N, h, w), (N, 1, h, w) or (N, h, w): of the whole input if they have its size."""
    masks = answer.named("mask")
    if masks is None or masks.ndim < 3:
        return None
    height, width = masks.shape[-2:]
    flat = masks.reshape(-1, height, width)[found]
    whole = (height, width) == (answer.size.height, answer.size.width)
    values = np.asarray(flat, np.float32)
    levels_8_bit = masks.dtype == np.uint8 and masks.size and int(masks.max()) > 1
    level = _EVEN * 255 if levels_8_bit else _EVEN
    return CandidateMasks(values, level, in_box=not whole if in_box is None else in_box)
