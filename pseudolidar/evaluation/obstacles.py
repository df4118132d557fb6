"""Distances of obstacles against labels: errors of the nearest face, by range."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.geometry.box_in_view import nearest_depth_m
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, Label
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.disparity import DepthMap
from pseudolidar.structures.obstacle import Obstacle

# Ranges of the true nearest face, m.
BANDS_M = ((0, 15), (15, 30), (30, 50), (50, 90))
# Bands with fewer objects are printed and not judged.
JUDGED_FROM = 10
# Labels that are judged: cut by the border no more than this, and hidden no more (KITTI's levels).
MOST_TRUNCATED, MOST_OCCLUDED = 0.15, 1
# A detection is of a label whose box it overlaps by this (intersection over union).
SAME_IOU = 0.5


@dataclass(frozen=True)
class JudgedObject:
    """One label and what was measured of it.

    Args:
        frame: id.
        name: class of the label.
        true_m: Z of the nearest face of its box in view.
        label_m: Z of the centre of its box.
        measured_m: ours; None where it was not found.
        sigma_m: one standard deviation of that.
        usual_m: depth at the middle of its box in the picture, as the usual script has it; None
            where there is none.
        size_off_m: length, width and height, ours less the label's; None where it was not found.
    """

    frame: str
    name: str
    true_m: float
    label_m: float
    measured_m: float | None = None
    sigma_m: float | None = None
    usual_m: float | None = None
    size_off_m: tuple[float, float, float] | None = None


def is_judged(label: Label) -> bool:
    """Whether a label counts: whole enough, in view enough, with a box."""
    return (
        not label.ignore
        and label.box is not None
        and (label.truncation or 0.0) <= MOST_TRUNCATED
        and (label.occlusion or 0) <= MOST_OCCLUDED
    )


def judged_objects(
    frame_id: str,
    labels: Iterable[Label],
    obstacles: Sequence[Obstacle],
    camera: Camera,
    depth: DepthMap,
) -> tuple[JudgedObject, ...]:
    """Each label that counts beside what was measured of it.

    Args:
        frame_id: of the frame.
        labels: of the frame.
        obstacles: of the frame, in `camera_left`.
        camera: of the picture.
        depth: of the picture, for the usual script.
    """
    labels = [label for label in labels if is_judged(label)]
    found = matched(labels, obstacles)
    judged = []
    for label, obstacle in zip(labels, found, strict=True):
        assert label.box is not None  # is_judged
        true_m = nearest_depth_m(label.box, camera)
        if true_m is None:
            continue
        judged.append(
            JudgedObject(
                frame_id,
                label.detection.name,
                true_m,
                float(label.box.pose.translation_m[2]),
                None if obstacle is None else obstacle.distance_m,
                None if obstacle is None else obstacle.sigma_distance_m,
                usual_depth_m(label, depth),
                None if obstacle is None else _size_off_m(obstacle.box, label.box),
            )
        )
    return tuple(judged)


def matched(labels: Sequence[Label], obstacles: Sequence[Obstacle]) -> list[Obstacle | None]:
    """The obstacle of each label: the best overlap of boxes in the picture first."""
    overlaps = np.array(
        [[iou(a.detection.box_px, b.detection.box_px) for b in obstacles] for a in labels]
    ).reshape(len(labels), len(obstacles))
    found: list[Obstacle | None] = [None] * len(labels)
    while overlaps.size and overlaps.max() >= SAME_IOU:
        row, column = np.unravel_index(int(np.argmax(overlaps)), overlaps.shape)
        found[int(row)] = obstacles[int(column)]
        overlaps[row, :] = overlaps[:, column] = -1.0
    return found


def usual_depth_m(label: Label, depth: DepthMap) -> float | None:
    """What the usual script says: the depth at the middle of the box; None where there is none."""
    left, top, right, bottom = label.detection.box_px
    height, width = depth.values.shape
    column = int(np.clip(round(0.5 * (left + right)), 0, width - 1))
    row = int(np.clip(round(0.5 * (top + bottom)), 0, height - 1))
    value = float(depth.values[row, column])
    return value if np.isfinite(value) else None


@dataclass(frozen=True)
class BandErrors:
    """Errors of the nearest face of the objects in one range.

    Args:
        from_m: of the true nearest face.
        to_m: likewise.
        n: objects.
        median_abs_m: median of the absolute errors; None where nothing was measured.
        p90_abs_m: 90th percentile of them.
        bias_m: median of the errors.
        missed: objects without a distance.
        within_1_sigma: share of the errors within sigma, 0-1; None where nobody gave one.
    """

    from_m: int
    to_m: int
    n: int
    median_abs_m: float | None
    p90_abs_m: float | None
    bias_m: float | None
    missed: int
    within_1_sigma: float | None

    def as_dict(self) -> dict[str, Any]:
        """The fields."""
        return dict(vars(self))


def by_band(objects: Sequence[JudgedObject]) -> tuple[BandErrors, ...]:
    """Errors of our distances by range."""
    return _bands(objects, [(o.measured_m, o.sigma_m) for o in objects], "true_m")


def usual_by_band(objects: Sequence[JudgedObject]) -> tuple[BandErrors, ...]:
    """Errors of the usual script's depths against what it compares them with: the label's z."""
    return _bands(objects, [(o.usual_m, None) for o in objects], "label_m")


def _bands(
    objects: Sequence[JudgedObject],
    measured: Sequence[tuple[float | None, float | None]],
    truth: str,
) -> tuple[BandErrors, ...]:
    true_m = np.array([o.true_m for o in objects])
    against_m = np.array([getattr(o, truth) for o in objects])
    # None becomes NaN.
    values = np.array([m for m, _ in measured], np.float64)
    sigmas = np.array([s for _, s in measured], np.float64)
    return tuple(
        _band(low, high, (values - against_m)[inside], sigmas[inside])
        for low, high in BANDS_M
        for inside in [(true_m >= low) & (true_m < high)]
    )


def _band(from_m: int, to_m: int, errors: Float64, sigmas: Float64) -> BandErrors:
    known = np.isfinite(errors)
    e, s = errors[known], sigmas[known]
    missed = int(np.count_nonzero(~known))
    if not len(e):
        return BandErrors(from_m, to_m, len(errors), None, None, None, missed, None)
    within = float(np.mean(np.abs(e) <= s)) if np.isfinite(s).all() else None
    median, p90 = np.quantile(np.abs(e), (0.5, 0.9))
    bias = float(np.median(e))
    return BandErrors(from_m, to_m, len(errors), float(median), float(p90), bias, missed, within)


def size_errors(
    objects: Sequence[JudgedObject], *, names: Sequence[str], nearer_than_m: float
) -> tuple[int, Float64] | None:
    """How many objects of these classes are nearer, and (3,) medians of their absolute errors.

    Of length, width and height, m; None where there is none.
    """
    off = [
        o.size_off_m
        for o in objects
        if o.name in names and o.true_m < nearer_than_m and o.size_off_m is not None
    ]
    return (len(off), np.median(np.abs(np.array(off)), axis=0)) if off else None


def _size_off_m(box: Box3D, truth: Box3D) -> tuple[float, float, float]:
    return (
        box.length_m - truth.length_m,
        box.width_m - truth.width_m,
        box.height_m - truth.height_m,
    )


def iou(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Of boxes left, top, right, bottom in continuous coordinates."""
    wide = min(a[2], b[2]) - max(a[0], b[0])
    tall = min(a[3], b[3]) - max(a[1], b[1])
    if wide <= 0 or tall <= 0:
        return 0.0
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return wide * tall / (sum(areas) - wide * tall)
