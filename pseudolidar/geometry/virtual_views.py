"""Several flat views of what a wide lens sees, each of them a rectified pair.

Turned about the baseline, both cameras of a rectified pair stay rectified. So the views are slices
around that axis, from above over ahead to below: together they show all that two lenses of 180
degrees see, but for the directions along the baseline, in which no pair measures anything.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pseudolidar.errors import CalibrationValue, UsageError
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import (
    FISHEYE_FIELD_DEG,
    NARROWEST_FIELD_DEG,
    WIDEST_FIELD_DEG,
    Rectification,
    aligning_rotations,
    turned,
)
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig

MOST_VIEWS = 9
# A slice that is higher has a flat picture whose edges are stretched by more than two.
HIGHEST_SLICE_DEG = 100.0
# Rows beyond the slice, for what a matcher looks at around its last ones.
ROWS_AROUND = 8
# Step in which the height of what both lenses see is measured, and how far it is looked for.
STEP_DEG, FARTHEST_DEG = 0.25, 120.0


def virtual_views(
    raw: StereoRig,
    views: int,
    *,
    zoom: float = 1.0,
    width_px: int | None = None,
    field_deg: float = FISHEYE_FIELD_DEG,
) -> tuple[Rectification, ...]:
    """Views around the baseline that show each direction once, the uppermost first.

    Args:
        raw: the cameras as they are.
        views: how many.
        zoom: resolution of a view's middle, as against that of the lens's.
        width_px: of a view, instead of what `zoom` makes it.
        field_deg: how wide each is along the baseline, degrees.

    Raises:
        UsageError: a number that makes no picture, or too few views for what the lenses see.
        CalibrationValue: the cameras do not stand side by side, or see nothing in common.
    """
    _check_numbers(views, field_deg)
    R_left, R_right = aligning_rotations(raw.T_right_left)
    first, last = seen_heights_deg(raw, R_left, R_right)
    slice_deg = (last - first) / views
    if slice_deg > HIGHEST_SLICE_DEG:
        raise UsageError(
            f"{views} views for lenses that see {last - first:.0f} degrees of height",
            want=f"{math.ceil((last - first) / HIGHEST_SLICE_DEG)} or more",
            where="rectify.views",
        )
    focal_px = zoom * float(np.mean([raw.left.K[1, 1], raw.right.K[1, 1]]))
    half_width = math.tan(math.radians(field_deg / 2))
    if width_px is not None:
        focal_px = width_px / (2 * half_width)
    width = width_px or round(2 * focal_px * half_width)
    shown = math.ceil(focal_px * math.tan(math.radians(slice_deg / 2)))
    height = 2 * (shown + ROWS_AROUND)
    K = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1.0]])
    found = []
    for number in range(views):
        turn = _about_baseline(first + (number + 0.5) * slice_deg)
        view = turned(raw, turn @ R_left, turn @ R_right, K, (width, height))
        found.append(replace(view, shown_rows=(ROWS_AROUND, height - ROWS_AROUND)))
    return tuple(found)


def seen_heights_deg(raw: StereoRig, R_left: Float64, R_right: Float64) -> tuple[float, float]:
    """Angles about the baseline, from straight ahead downwards, between which both lenses see.

    Args:
        raw: the cameras as they are.
        R_left: (3, 3) turns the left one's directions so that rows lie along the baseline.
        R_right: (3, 3) the same for the right one.

    Raises:
        CalibrationValue: they do not both see what is straight ahead.
    """
    angles = np.arange(-FARTHEST_DEG, FARTHEST_DEG + STEP_DEG, STEP_DEG)
    radians = np.deg2rad(angles)
    ahead = np.stack([np.zeros_like(radians), np.sin(radians), np.cos(radians)], axis=-1)
    seen = np.ones(len(angles), np.bool_)
    for camera, R in ((raw.left, R_left), (raw.right, R_right)):
        lens = Lens.of(camera)
        uv, holds = lens.pixels(ahead @ R)
        seen &= holds & lens.inside(uv)
    middle = len(angles) // 2
    if not seen[middle]:
        raise CalibrationValue(
            "cameras that do not both see what is straight ahead of the pair",
            want="cameras that look the same way",
            where="T_right_left",
        )
    above = np.flatnonzero(~seen[:middle])
    below = np.flatnonzero(~seen[middle:])
    first = above[-1] + 1 if len(above) else 0
    last = middle + below[0] - 1 if len(below) else len(angles) - 1
    return float(angles[first]), float(angles[last])


def _about_baseline(angle_deg: float) -> Float64:
    """(3, 3) turns directions into a view that looks `angle_deg` below straight ahead."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _check_numbers(views: int, field_deg: float) -> None:
    if not 1 <= views <= MOST_VIEWS:
        raise UsageError(f"{views} views", want=f"1 to {MOST_VIEWS}", where="rectify.views")
    if not NARROWEST_FIELD_DEG <= field_deg <= WIDEST_FIELD_DEG:
        raise UsageError(
            f"field {field_deg:g}",
            want=f"{NARROWEST_FIELD_DEG:g} to {WIDEST_FIELD_DEG:g}",
            where="rectify.field_deg",
        )
