"""KITTI's average precision beside the loops of its devkit, written out, on frames by chance."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.average_precision import (
    DIFFICULTIES,
    MIN_OVERLAPS,
    BoxedFrame,
    average_precisions,
)
from pseudolidar.structures.box import Box3D, Detection, Label
from pseudolidar.structures.pose import Pose

CLASSES = ("Car", "Van", "Pedestrian")
NO_DETECTION = -1e7
MIN_HEIGHT, MAX_OCCLUSION, MAX_TRUNCATION = (40, 25, 25), (0, 1, 2), (0.15, 0.3, 0.5)


def by_chance(rng: np.random.Generator) -> BoxedFrame:
    """Labels and findings of any class, height and score; every overlap is possible."""
    labels, found = int(rng.integers(0, 9)), int(rng.integers(0, 12))
    box = Box3D(Pose.identity("camera_left", "box"), 4.0, 2.0, 1.5)

    def label() -> Label:
        height = float(rng.choice([20.0, 25.0, 30.0, 40.0, 41.5, 90.0]))
        return Label(
            Detection(str(rng.choice(CLASSES, p=[0.7, 0.2, 0.1])), (0.0, 0.0, 30.0, height)),
            box,
            float(rng.choice([0.0, 0.2, 0.4])),
            int(rng.integers(0, 4)),
        )

    return BoxedFrame(
        tuple(label() for _ in range(labels)),
        tuple(str(rng.choice(["car", "car", "car", "pedestrian"])) for _ in range(found)),
        rng.random(found),
        rng.choice([20.0, 24.9, 25.0, 40.5, 80.0], found),
        rng.choice([0.0, 0.3, 0.6, 0.8], (labels, found, 2)) + 0.1 * rng.random((labels, found, 2)),
    )


def cleaned(frame: BoxedFrame, level: int) -> tuple[list[int], list[int]]:
    """`cleanData` for cars: 0 counts, 1 is ignored, -1 is another class."""
    ignored_gt = []
    for label in frame.labels:
        name, (_, top, _, bottom) = label.detection.name, label.detection.box_px
        valid = {"Car": 1, "Van": 0}.get(name, -1)
        hard = (
            label.occlusion > MAX_OCCLUSION[level]
            or label.truncation > MAX_TRUNCATION[level]
            or bottom - top <= MIN_HEIGHT[level]
        )
        if valid == 1 and not hard:
            ignored_gt.append(0)
        else:
            ignored_gt.append(1 if valid == 0 or (hard and valid == 1) else -1)
    ignored_det = [
        1 if int(height) < MIN_HEIGHT[level] else (0 if name == "car" else -1)
        for name, height in zip(frame.names, frame.heights_px, strict=True)
    ]
    return ignored_gt, ignored_det


def statistics(frame, clean, view, min_overlap, *, compute_fp=False, threshold=0.0):
    """`computeStatistics`: true and false positives, and scores of the true ones."""
    ignored_gt, ignored_det = clean
    overlap, score = frame.overlap[:, :, view], frame.scores
    assigned = [False] * len(score)
    below = [compute_fp and one < threshold for one in score]
    true, scores = 0, []
    for i, kind in enumerate(ignored_gt):
        if kind == -1:
            continue
        chosen, valid, best, took_ignored = -1, NO_DETECTION, 0.0, False
        for j in range(len(score)):
            if ignored_det[j] == -1 or assigned[j] or below[j] or overlap[i, j] <= min_overlap:
                continue
            if not compute_fp and score[j] > valid:
                chosen, valid = j, score[j]
            elif compute_fp and (overlap[i, j] > best or took_ignored) and ignored_det[j] == 0:
                chosen, valid, best, took_ignored = j, 1, overlap[i, j], False
            elif compute_fp and valid == NO_DETECTION and ignored_det[j] == 1:
                chosen, valid, took_ignored = j, 1, True
        if valid != NO_DETECTION:
            assigned[chosen] = True
            if kind == 0 and ignored_det[chosen] == 0:
                true += 1
                scores.append(score[chosen])
    false = sum(not (assigned[j] or ignored_det[j] != 0 or below[j]) for j in range(len(score)))
    return true, false, scores


def thresholds(scores: list[float], n: int) -> list[float]:
    """`getThresholds`."""
    chosen, current = [], 0.0
    ordered = sorted(scores, reverse=True)
    for i, score in enumerate(ordered):
        last = i == len(ordered) - 1
        left = (i + 1) / n
        right = left if last else (i + 2) / n
        if right - current < current - left and not last:
            continue
        chosen.append(score)
        current += 1.0 / 40.0
    return chosen


def devkit(frames, level: int, view: int, min_overlap: float) -> float:
    clean = [cleaned(frame, level) for frame in frames]
    n = sum(kinds.count(0) for kinds, _ in clean)
    scores = [
        score
        for frame, one in zip(frames, clean, strict=True)
        for score in statistics(frame, one, view, min_overlap)[2]
    ]
    precision = np.zeros(41)
    for k, threshold in enumerate(thresholds(scores, n)):
        told = [
            statistics(frame, one, view, min_overlap, compute_fp=True, threshold=threshold)
            for frame, one in zip(frames, clean, strict=True)
        ]
        true, false = sum(one[0] for one in told), sum(one[1] for one in told)
        precision[k] = true / (true + false) if true + false else 0.0
    for k in range(41):
        precision[k] = precision[k:].max()
    return float(precision[1:].mean())


@pytest.mark.parametrize("seed", range(4))
def test_frames_by_chance_have_the_precision_of_the_devkit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = [by_chance(rng) for _ in range(40)]
    ours = [one for one in average_precisions(frames) if one.name == "Car"]
    assert len(ours) == len(DIFFICULTIES) * len(MIN_OVERLAPS)
    assert sum(one.bev > 0 and one.space > 0 for one in ours) >= 2  # chance leaves few easy ones
    for one in ours:
        level = [difficulty.name for difficulty in DIFFICULTIES].index(one.difficulty)
        for view, value in enumerate((one.bev, one.space)):
            assert value == pytest.approx(devkit(frames, level, view, one.min_overlap), abs=1e-12)
