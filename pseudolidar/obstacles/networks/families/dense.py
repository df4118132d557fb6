"""Detectors that answer for every cell of a grid: YOLOX, YOLOv5 and v7, Ultralytics, NanoDet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import ModelOutput
from pseudolidar.obstacles.networks.answer import (
    Answer,
    CandidateMasks,
    Candidates,
    corners,
    in_pixels,
    kept,
)
from pseudolidar.obstacles.networks.families.grids import cells, strides_of
from pseudolidar.obstacles.networks.families.reading import LETTERBOXED, are_scores, unread
from pseudolidar.obstacles.networks.layout import DetectorLayout, FamilyName
from pseudolidar.structures.arrays import AnyArray, Float64, Int64

# A network trained on decoded boxes spreads their centres over its input; offsets in a grid stay
# within some cells.
_SPREAD_SHARE = 0.1
# Bins of NanoDet's distributions, the published ones first.
_BINS = (8, 11, 16, 17)
# A larger logarithm is of no picture: 16-bit networks overflow in cells of nothing.
_LARGEST_LOG = 12.0


@dataclass(frozen=True)
class Yolox:
    """(1, N, 5 + classes), one box a cell: x, y, width, height, is an object, is of each class."""

    name: FamilyName = "yolox"
    form: str = "one output (1, cells, 5 + classes)"
    overlapping: bool = True

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """Offsets in a grid or pixels; YOLOv6 is sure of an object in all cells, and fed RGB."""
        rows = _rows(answer)
        if rows is None or rows.shape[1] < 6 or len(answer.outputs) > 1:
            return None
        classes = rows.shape[1] - 5
        fits = strides_of(len(rows), answer.size) and known.classes in (None, classes)
        if not fits or not are_scores(rows[:, 4:]):
            return None
        common = DetectorLayout(family=self.name, fill=114, classes=classes, first_label=0)
        if np.all(rows[:, 4] == 1):  # YOLOv6 keeps the column and has no such score
            unit = DetectorLayout(normalisation="unit", channels="rgb", fit="centre")
            return common.filled(unit).filled(DetectorLayout(boxes="pixel"))
        spread = float(np.std(rows[:, 0])) > _SPREAD_SHARE * answer.size.width
        boxes = DetectorLayout(boxes="pixel" if spread and rows[:, 2:4].min() >= 0 else "grid")
        raw = DetectorLayout(normalisation="raw", channels="bgr", fit="corner")
        return common.filled(raw).filled(boxes)

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """Source: Ge et al., YOLOX, 2021, section 2: centre + offset, exp of the size."""
        rows = _needed(answer, self.form)
        scores, labels = _best(rows[:, 4:5] * rows[:, 5:])
        found = kept(scores, threshold)
        boxes = np.asarray(rows[found, :4], np.float64)
        if layout.boxes == "grid":
            strides = strides_of(len(rows), answer.size)
            if strides is None:
                raise _no_cells(len(rows), answer)
            cell = cells(answer.size, strides)[found]
            sizes = np.exp(np.minimum(boxes[:, 2:], _LARGEST_LOG))
            boxes = np.concatenate([boxes[:, :2] + cell[:, :2], sizes], axis=1) * cell[:, 2:]
        boxes = in_pixels(corners(boxes), layout.boxes, answer.size)
        return Candidates(boxes, scores[found], labels[found])


@dataclass(frozen=True)
class Yolov5:
    """(1, N, 5 + classes (+ K)), three boxes a cell; K coefficients of (1, K, h, w) prototypes."""

    name: FamilyName = "yolov5"
    form: str = "one output (1, 3 x cells, 5 + classes), prototypes (1, 32, h, w) for masks"
    overlapping: bool = True

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By the number of boxes."""
        rows, masks = _rows(answer), _prototypes(answer)
        few = 0 if masks is None else len(masks)
        if rows is None or rows.shape[1] < 6 + few or not strides_of(len(rows), answer.size, 3):
            return None
        classes = rows.shape[1] - 5 - few
        if known.classes not in (None, classes) or not are_scores(rows[:, 4 : 5 + classes]):
            return None
        return LETTERBOXED.filled(DetectorLayout(family=self.name, classes=classes))

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """The score is that of an object times that of its best class."""
        rows = _needed(answer, self.form)
        end = _classes_end(rows, 5, layout)
        scores, labels = _best(rows[:, 4:5] * rows[:, 5:end])
        found = kept(scores, threshold)
        boxes = in_pixels(corners(rows[found, :4]), layout.boxes, answer.size)
        return Candidates(boxes, scores[found], labels[found], _masks(answer, rows[found], end))


@dataclass(frozen=True)
class Ultralytics:
    """(1, 4 + classes (+ K), N), one box a cell, as YOLOv8 to YOLO12 are exported."""

    name: FamilyName = "ultralytics"
    form: str = "one output (1, 4 + classes, cells), prototypes (1, 32, h, w) for masks"
    overlapping: bool = True

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By the number of cells; what is after the classes must be coefficients of masks."""
        columns, masks = _columns(answer), _prototypes(answer)
        few = 0 if masks is None else len(masks)
        if columns is None or columns.shape[1] < 5 + few:
            return None
        if not strides_of(len(columns), answer.size):
            return None
        classes = known.classes or columns.shape[1] - 4 - few
        if classes > columns.shape[1] - 4 - few or not are_scores(columns[:, 4 : 4 + classes]):
            return None
        return LETTERBOXED.filled(DetectorLayout(family=self.name, classes=classes))

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """The score is that of the best class."""
        columns = _columns(answer)
        if columns is None:
            raise unread(answer, self.form)
        end = _classes_end(columns, 4, layout)
        scores, labels = _best(columns[:, 4:end])
        found = kept(scores, threshold)
        boxes = in_pixels(corners(columns[found, :4]), layout.boxes, answer.size)
        masks = _masks(answer, columns[found], columns.shape[1] - _few(answer))
        return Candidates(boxes, scores[found], labels[found], masks)


@dataclass(frozen=True)
class Nanodet:
    """(1, N, classes + 4 bins): scores, and a distribution of the distance to each side."""

    name: FamilyName = "nanodet"
    form: str = "one output (1, cells, classes + 4 bins), or one pair of outputs a stride"
    overlapping: bool = True

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """By the number of cells, and columns that are no scores."""
        rows = _distributions(answer)
        if rows is None or not strides_of(len(rows), answer.size):
            return None
        classes = known.classes or _classes_before_bins(rows)
        bins = (rows.shape[1] - (classes or 0)) // 4
        if not classes or 4 * bins + classes != rows.shape[1] or bins < 2:
            return None
        if not are_scores(rows[:, :classes]):
            return None
        return DetectorLayout(
            family=self.name,
            normalisation="imagenet",
            channels="bgr",
            fit="stretch",
            fill=0,
            boxes="pixel",
            classes=classes,
            first_label=0,
        )

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """Source: Li et al., Generalized Focal Loss, 2020, equation 7: the mean of the bins.

        Cells of NanoDet-Plus, which has a fourth stride, begin where its pixels do; those of
        NanoDet have their centres there.
        """
        rows = _distributions(answer)
        if rows is None:
            raise unread(answer, self.form)
        strides = strides_of(len(rows), answer.size)
        if strides is None:
            raise _no_cells(len(rows), answer)
        classes = layout.classes or _classes_before_bins(rows) or 1
        scores, labels = _best(rows[:, :classes])
        found = kept(scores, threshold)
        cell = cells(answer.size, strides)[found]
        bins = np.asarray(rows[found, classes:], np.float64).reshape(len(found), 4, -1)
        odds = np.exp(bins - bins.max(axis=2, keepdims=True))
        mean = odds @ np.arange(bins.shape[2]) / odds.sum(axis=2)
        at = cell[:, :2] + (0.0 if len(strides) > 3 else 0.5)
        boxes = np.concatenate([at - mean[:, :2], at + mean[:, 2:]], axis=1) * cell[:, 2:]
        return Candidates(boxes, scores[found], labels[found])


def _rows(answer: Answer) -> AnyArray | None:
    """(N, C) of the one output that has a row for every box."""
    flat = [a for a in answer.arrays if a.ndim == 3 and a.shape[0] == 1 and a.dtype.kind == "f"]
    return np.asarray(flat[0][0], np.float32) if len(flat) == 1 else None


def _columns(answer: Answer) -> AnyArray | None:
    """(N, C) of the one output that has a column for every box."""
    rows = _rows(answer)
    return None if rows is None else rows.T


def _needed(answer: Answer, form: str) -> AnyArray:
    rows = _rows(answer)
    if rows is None:
        raise unread(answer, form)
    return rows


def _prototypes(answer: Answer) -> AnyArray | None:
    """(K, h, w) of an output of maps."""
    maps = [a for a in answer.arrays if a.ndim == 4 and a.shape[0] == 1 and a.dtype.kind == "f"]
    return maps[0][0] if len(maps) == 1 else None


def _few(answer: Answer) -> int:
    maps = _prototypes(answer)
    return 0 if maps is None else len(maps)


def _masks(answer: Answer, rows: AnyArray, end: int) -> CandidateMasks | None:
    """Coefficients after the classes."""
    maps = _prototypes(answer)
    if maps is None:
        return None
    coefficients = np.asarray(rows[:, end : end + len(maps)], np.float32)
    return CandidateMasks(coefficients, 0.0, prototypes=np.asarray(maps, np.float32))


def _classes_end(rows: AnyArray, start: int, layout: DetectorLayout) -> int:
    return start + layout.classes if layout.classes else rows.shape[1]


def _distributions(answer: Answer) -> AnyArray | None:
    """(N, classes + 4 bins), put together where scores and distances of each stride are apart."""
    rows = _rows(answer)
    if rows is not None:
        return rows
    flat = [a[0] for a in answer.arrays if a.ndim == 3 and a.shape[0] == 1]
    scores = sorted((a for a in flat if are_scores(a)), key=len, reverse=True)
    bins = sorted((a for a in flat if not are_scores(a)), key=len, reverse=True)
    if not scores or [len(a) for a in scores] != [len(a) for a in bins]:
        return None
    if len({a.shape[1] for a in scores}) > 1 or len({a.shape[1] for a in bins}) > 1:
        return None
    parts = [np.concatenate(pair, axis=1) for pair in zip(scores, bins, strict=True)]
    return np.concatenate(parts)


def _classes_before_bins(rows: AnyArray) -> int | None:
    """Columns that are scores, where the rest are four distributions of a usual number of bins."""
    scores = [are_scores(rows[:, i : i + 1]) for i in range(rows.shape[1])]
    leading = scores.index(False) if False in scores else len(scores)
    if leading == rows.shape[1]:
        return None
    fitting = [rows.shape[1] - 4 * bins for bins in _BINS]
    return next((classes for classes in fitting if 0 < classes <= leading), None)


def _best(scores: AnyArray) -> tuple[Float64, Int64]:
    """(N,) the best score of each row, and its column.

    Raises:
        ModelOutput: it is the same everywhere, and not nothing.
    """
    labels = np.asarray(scores.argmax(axis=1), np.int64)
    best = np.asarray(np.take_along_axis(scores, labels[:, None], axis=1)[:, 0], np.float64)
    if len(best) > 1 and best[0] > 0 and np.ptp(scores) == 0:
        raise ModelOutput(
            f"every score is {best[0]:.3g}",
            want="scores that differ",
            fix="The network sees nothing in this picture, or is fed wrongly.",
        )
    return best, labels


def _no_cells(count: int, answer: Answer) -> ModelOutput:
    return ModelOutput(
        f"{count} boxes of an input of {answer.size}", want="as many as cells of strides 8, 16, 32"
    )
