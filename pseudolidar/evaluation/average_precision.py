"""Average precision of boxes from above and in space, by KITTI's definition with 40 recalls.

Source: the KITTI object devkit (evaluate_object.cpp), with the 40 recall positions of Simonelli et
al., Disentangling Monocular 3D Object Detection, ICCV 2019: recall 0 does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pseudolidar.geometry.box_overlap import overlaps
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.box import Label
from pseudolidar.structures.obstacle import Obstacle

View = Literal["bev", "3d"]
RECALLS = 40
MIN_OVERLAPS = (0.5, 0.7)
# Classes that are no mistake for another one, and count for neither.
NEIGHBOURS = {"car": "van", "pedestrian": "person_sitting"}
# What detectors that learnt from COCO call them.
ALIASES = {"person": "pedestrian"}
COUNTS, IGNORED, OTHER = 0, 1, -1


@dataclass(frozen=True)
class Difficulty:
    """Which labels count.

    Args:
        name: easy, moderate, hard.
        least_px: height of the box in the picture.
        most_occluded: KITTI's level.
        most_truncated: share outside of the picture.
    """

    name: str
    least_px: float
    most_occluded: int
    most_truncated: float


DIFFICULTIES = (
    Difficulty("easy", 40.0, 0, 0.15),
    Difficulty("moderate", 25.0, 1, 0.30),
    Difficulty("hard", 25.0, 2, 0.50),
)


@dataclass(frozen=True, eq=False)
class BoxedFrame:
    """Labels and found boxes of a frame, with all that AP needs of them.

    Args:
        labels: of the frame.
        names: classes of what was found, lower case.
        scores: (N,) of what was found.
        heights_px: (N,) of its boxes in the picture.
        overlap: (labels, N, 2) from above and in space; 0 where a label has no box.
    """

    labels: tuple[Label, ...]
    names: tuple[str, ...]
    scores: Float64
    heights_px: Float64
    overlap: Float64

    @classmethod
    def of(cls, labels: Sequence[Label], obstacles: Sequence[Obstacle]) -> BoxedFrame:
        """With every pair compared."""
        shared = np.zeros((len(labels), len(obstacles), 2))
        for i, label in enumerate(labels):
            for j, obstacle in enumerate(obstacles):
                if label.box is not None:
                    shared[i, j] = overlaps(label.box, obstacle.box)
        boxes = [one.detection.box_px for one in obstacles]
        return cls(
            tuple(labels),
            tuple(_known_name(one.detection.name) for one in obstacles),
            np.array([one.confidence for one in obstacles], np.float64),
            np.array([bottom - top for _, top, _, bottom in boxes], np.float64),
            shared,
        )


def _known_name(name: str) -> str:
    """The class as KITTI calls it, lower case."""
    return ALIASES.get(name.lower(), name.lower())


@dataclass(frozen=True)
class AveragePrecision:
    """AP of one class at one difficulty and overlap.

    Args:
        name: class.
        difficulty: easy, moderate, hard.
        min_overlap: intersection over union that makes a match.
        n: labels that count.
        bev: from above, 0-1; None where no label counts.
        space: in 3D, likewise.
    """

    name: str
    difficulty: str
    min_overlap: float
    n: int
    bev: float | None
    space: float | None

    def as_dict(self) -> dict[str, Any]:
        """The fields, `3d` for space."""
        fields = dict(vars(self))
        fields["3d"] = fields.pop("space")
        fields["class"] = fields.pop("name")
        return fields


def average_precisions(frames: Sequence[BoxedFrame]) -> tuple[AveragePrecision, ...]:
    """AP of every class that labels and found boxes have in common."""
    labelled = {one.detection.name for frame in frames for one in frame.labels if not one.ignore}
    found = {name for frame in frames for name in frame.names}
    return tuple(
        _precision(frames, name, difficulty, min_overlap)
        for name in sorted(labelled)
        if name.lower() in found
        for min_overlap in MIN_OVERLAPS
        for difficulty in DIFFICULTIES
    )


def _precision(
    frames: Sequence[BoxedFrame], name: str, difficulty: Difficulty, min_overlap: float
) -> AveragePrecision:
    use = [_used(frame, name.lower(), difficulty) for frame in frames]
    n = sum(int(np.count_nonzero(labels == COUNTS)) for labels, _ in use)
    values: list[float | None] = [
        _ap(frames, use, view, min_overlap, n) if n else None for view in (0, 1)
    ]
    return AveragePrecision(name, difficulty.name, min_overlap, n, values[0], values[1])


def _used(frame: BoxedFrame, name: str, difficulty: Difficulty) -> tuple[Int64, Int64]:
    """What each label and each found box is to a class: counts, ignored, or another."""
    labels = []
    for label in frame.labels:
        own = label.detection.name.lower()
        _, top, _, bottom = label.detection.box_px
        hard = (
            (label.occlusion or 0) > difficulty.most_occluded
            or (label.truncation or 0.0) > difficulty.most_truncated
            or bottom - top <= difficulty.least_px
        )
        if own == name and not label.ignore:
            labels.append(IGNORED if hard else COUNTS)
        else:
            labels.append(IGNORED if NEIGHBOURS.get(name) == own else OTHER)
    # The devkit asks for whole pixels of height first, and for the class only then.
    found = [
        IGNORED if int(height) < difficulty.least_px else (COUNTS if own == name else OTHER)
        for own, height in zip(frame.names, frame.heights_px, strict=True)
    ]
    return np.array(labels, np.int64), np.array(found, np.int64)


def _ap(
    frames: Sequence[BoxedFrame],
    use: Sequence[tuple[Int64, Int64]],
    view: int,
    min_overlap: float,
    n: int,
) -> float:
    scores: list[float] = []
    for frame, (labels, found) in zip(frames, use, strict=True):
        scores += _right_scores(frame, labels, found, view, min_overlap)
    precision = np.zeros(RECALLS + 1)
    for i, least in enumerate(_thresholds(scores, n)):
        right, wrong = 0, 0
        for frame, (labels, found) in zip(frames, use, strict=True):
            a, b = _counts(frame, labels, found, view, min_overlap, least)
            right, wrong = right + a, wrong + b
        precision[i] = right / max(1, right + wrong)
    best = np.maximum.accumulate(precision[::-1])[::-1]
    return float(best[1:].mean())


def _right_scores(
    frame: BoxedFrame, labels: Int64, found: Int64, view: int, min_overlap: float
) -> list[float]:
    """Scores of the best scored match of each label that counts."""
    taken = np.zeros(len(found), bool)
    scores = []
    for i in np.flatnonzero(labels != OTHER):
        fits = (frame.overlap[i, :, view] > min_overlap) & (found != OTHER) & ~taken
        if not fits.any():
            continue
        best = int(np.argmax(np.where(fits, frame.scores, -1.0)))
        taken[best] = True
        if labels[i] == COUNTS and found[best] == COUNTS:
            scores.append(float(frame.scores[best]))
    return scores


def _counts(
    frame: BoxedFrame, labels: Int64, found: Int64, view: int, min_overlap: float, least: float
) -> tuple[int, int]:
    """Right and wrong ones among those with this score or more."""
    seen = (found != OTHER) & (frame.scores >= least)
    taken = np.zeros(len(found), bool)
    right = 0
    for i in np.flatnonzero(labels != OTHER):
        shared = frame.overlap[i, :, view]
        fits = (shared > min_overlap) & seen & ~taken
        sure = fits & (found == COUNTS)
        if not fits.any():
            continue
        best = int(np.argmax(np.where(sure if sure.any() else fits, shared, -1.0)))
        taken[best] = True
        right += int(labels[i] == COUNTS and found[best] == COUNTS)
    return right, int(np.count_nonzero(seen & ~taken & (found == COUNTS)))


def _thresholds(scores: Sequence[float], n: int) -> list[float]:
    """Scores at which recall is nearest to 0, 1/40, 2/40, ...; as the devkit chooses them."""
    ordered = sorted(scores, reverse=True)
    chosen: list[float] = []
    recall = 0.0
    for i, score in enumerate(ordered):
        left = (i + 1) / n
        right = (i + 2) / n if i < len(ordered) - 1 else left
        if right - recall < recall - left and i < len(ordered) - 1:
            continue
        chosen.append(score)
        recall += 1.0 / RECALLS
    return chosen[: RECALLS + 1]
