"""Detectors that answer with rows, one an object or a query: end to end, YOLOv7, DETR."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.networks.answer import (
    Answer,
    CandidateMasks,
    Candidates,
    corners,
    kept,
)
from pseudolidar.obstacles.networks.families.reading import (
    LETTERBOXED,
    are_labels,
    are_scores,
    box_unit,
    listed,
    unread,
)
from pseudolidar.obstacles.networks.layout import DetectorLayout, FamilyName
from pseudolidar.structures.arrays import AnyArray, Float64


@dataclass(frozen=True)
class EndToEnd:
    """(1, N, 6 (+ K)): left, top, right, bottom, score, class, K coefficients of prototypes."""

    name: FamilyName = "end-to-end"
    form: str = "one output (1, boxes, 6), prototypes (1, 32, h, w) for masks"
    overlapping: bool = False

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By six columns, of which the last is whole numbers."""
        rows, maps = _split(answer)
        if rows is None or rows.shape[1] != 6 + (0 if maps is None else len(maps)):
            return None
        if not (are_scores(rows[:, 4]) and are_labels(rows[:, 5])):
            return None
        own = DetectorLayout(family=self.name, boxes=box_unit(rows[:, :4]), classes=known.classes)
        return own.filled(LETTERBOXED)

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """Rows with the scores that are asked for."""
        rows, maps = _split(answer)
        if rows is None or rows.shape[1] < 6:
            raise unread(answer, self.form)
        found = kept(rows[:, 4], threshold)
        masks = None
        if maps is not None:
            coefficients = np.asarray(rows[found, 6 : 6 + len(maps)], np.float32)
            masks = CandidateMasks(coefficients, 0.0, prototypes=np.asarray(maps, np.float32))
        return listed(answer, layout, rows[:, :4], rows[:, 4], rows[:, 5], found, masks)


@dataclass(frozen=True)
class Rows:
    """(N, 7): number of the picture, left, top, right, bottom, class, score (YOLOv7's own end)."""

    name: FamilyName = "rows"
    form: str = "one output (boxes, 7)"
    overlapping: bool = False

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By its seven columns; it may have no row."""
        rows = answer.arrays[0]
        if len(answer.outputs) > 1 or rows.ndim != 2 or rows.shape[1] != 7:
            return None
        if not (are_scores(rows[:, 6]) and are_labels(rows[:, 5]) and np.all(rows[:, 0] == 0)):
            return None
        # Rows of several pictures would come in one list.
        return LETTERBOXED.filled(
            DetectorLayout(family=self.name, boxes="pixel", classes=known.classes, batch=1)
        )

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """Rows with the scores that are asked for."""
        rows = answer.arrays[0]
        if rows.ndim != 2 or rows.shape[1] != 7:
            raise unread(answer, self.form)
        found = kept(rows[:, 6], threshold)
        return listed(answer, layout, rows[:, 1:5], rows[:, 6], rows[:, 5], found)


@dataclass(frozen=True)
class Queries:
    """(1, N, 4 + classes) of shares: centre, size, scores (RT-DETR of Ultralytics)."""

    name: FamilyName = "queries"
    form: str = "one output (1, boxes, 4 + classes)"
    overlapping: bool = False

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By values that are all 0-1; tried after all others."""
        rows, maps = _split(answer)
        if rows is None or maps is not None or rows.shape[1] < 5 or len(rows) < rows.shape[1]:
            return None
        classes = rows.shape[1] - 4
        if known.classes not in (None, classes) or not are_scores(rows.ravel()):
            return None
        stretched = DetectorLayout(fit="stretch", boxes="share", classes=classes)
        return stretched.filled(DetectorLayout(family=self.name)).filled(LETTERBOXED)

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """The score is that of the best class."""
        rows, _maps = _split(answer)
        if rows is None:
            raise unread(answer, self.form)
        scores, labels = rows[:, 4:].max(axis=1), rows[:, 4:].argmax(axis=1)
        found = kept(scores, threshold)
        boxes = corners(rows[:, :4])
        return listed(answer, layout, boxes, scores, labels, found)


@dataclass(frozen=True)
class Pairs:
    """(1, N, 4) boxes and (1, N, classes) scores: DETR and its kin; YOLO-NAS in pixels.

    Shares are centre and size, pixels are corners; scores that are not 0-1 are logits: with a last
    class "no object" (92 of DETR) they share one sum, otherwise each stands alone.
    """

    name: FamilyName = "pairs"
    form: str = "outputs (1, boxes, 4) and (1, boxes, classes)"
    overlapping: bool = True

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By two outputs of as many rows."""
        pair = _pair(answer)
        if pair is None:
            return None
        boxes, scores = pair
        classes = scores.shape[1] - (1 if _has_nothing(scores) else 0)
        if known.classes not in (None, classes):
            return None
        common = DetectorLayout(family=self.name, classes=classes, first_label=0)
        if box_unit(boxes) == "pixel":
            return common.filled(LETTERBOXED)
        # 91 labels of COCO, of which the first is never used.
        first = 1 if classes in (90, 91) else 0
        detr = DetectorLayout(normalisation="imagenet", channels="rgb", fit="stretch", fill=0)
        shares = DetectorLayout(boxes="share", classes=classes, first_label=first)
        return shares.filled(common).filled(detr)

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """The score is that of the best class."""
        pair = _pair(answer)
        if pair is None:
            raise unread(answer, self.form)
        boxes, raw = pair
        odds = _probabilities(raw)
        scores, labels = odds.max(axis=1, initial=0.0), odds.argmax(axis=1)
        found = kept(scores, threshold)
        if layout.boxes == "share":
            boxes = corners(boxes)
        return listed(answer, layout, boxes, scores, labels, found)


def _split(answer: Answer) -> tuple[AnyArray | None, AnyArray | None]:
    """(N, C) rows, and (K, h, w) prototypes where there are."""
    flat = [a for a in answer.arrays if a.ndim == 3 and a.shape[0] == 1]
    maps = [a for a in answer.arrays if a.ndim == 4 and a.shape[0] == 1]
    fits = len(flat) == 1 and len(maps) <= 1 and len(answer.outputs) == 1 + len(maps)
    rows = flat[0][0] if fits else None
    return rows, maps[0][0] if maps else None


def _pair(answer: Answer) -> tuple[AnyArray, AnyArray] | None:
    """(N, 4) boxes and (N, classes) scores."""
    flat = [a for a in answer.arrays if a.ndim == 3 and a.shape[0] == 1 and a.dtype.kind == "f"]
    if len(answer.outputs) != 2 or len(flat) != 2 or flat[0].shape[1] != flat[1].shape[1]:
        return None
    boxes = [a for a in flat if a.shape[2] == 4]
    scores = [a for a in flat if a.shape[2] != 4]
    if len(boxes) != 1 or len(scores) != 1:
        return None
    return boxes[0][0], np.asarray(scores[0][0], np.float64)


def _has_nothing(scores: AnyArray) -> bool:
    """Whether the last column means no object: 92 logits, as DETR has for COCO."""
    return scores.shape[1] == 92 and not are_scores(scores.ravel())


def _probabilities(raw: Float64) -> Float64:
    if raw.size == 0 or are_scores(raw.ravel()):
        return raw
    if _has_nothing(raw):
        odds = np.exp(raw - raw.max(axis=1, keepdims=True))
        return np.asarray((odds / odds.sum(axis=1, keepdims=True))[:, :-1], np.float64)
    with np.errstate(over="ignore"):
        return np.asarray(1 / (1 + np.exp(-raw)), np.float64)
