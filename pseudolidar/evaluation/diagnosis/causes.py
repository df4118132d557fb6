"""What can be wrong with a rig, and the disparity error that each such thing makes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.diagnosis.blocks import ErrorBlocks
from pseudolidar.geometry.projection import px_per_radian
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig


@dataclass(frozen=True, eq=False)
class Seen:
    """Blocks as both cameras see them.

    Args:
        d_px: (N,) disparity above that of infinity.
        x_px: (N,) column in the right image, from its principal point.
        y_px: (N,) row, from the principal point.
        left_x_px: (N,) column in the left image, from its principal point.
        slope: two of (N,), how disparities change along columns and rows, px a px.
        focal_px: focal length.
        fB_px_m: focal length times baseline.
        height_px: height of the image.
    """

    d_px: Float64
    x_px: Float64
    y_px: Float64
    left_x_px: Float64
    slope: tuple[Float64, Float64]
    focal_px: float
    fB_px_m: float
    height_px: int

    @classmethod
    def of(cls, blocks: ErrorBlocks, rig: StereoRig) -> Seen:
        """Of the blocks of a rig."""
        K = rig.right.K
        return cls(
            d_px=blocks.reference_px + rig.doffs_px,
            x_px=blocks.u - blocks.reference_px - float(K[0, 2]),
            y_px=blocks.v - float(K[1, 2]),
            left_x_px=blocks.u - float(rig.left.K[0, 2]),
            slope=(blocks.slope_u, blocks.slope_v),
            focal_px=rig.right.focal_px,
            fB_px_m=rig.fB_px_m,
            height_px=rig.left.height_px,
        )


Pattern = Callable[[Seen], Float64]


@dataclass(frozen=True)
class Cause:
    """One parameter that may be wrong.

    Args:
        name: identifier, as in JSON.
        unit: of its size.
        pattern: (N,) px of disparity error for each unit of it.
        words: what is the case, with `{size}` for the absolute size and its unit, where it is
            positive, and where it is negative.
    """

    name: str
    unit: str
    pattern: Pattern
    words: tuple[str, str]


def _scale(seen: Seen) -> Float64:
    return np.asarray(-seen.d_px / 100.0)


def _offset(seen: Seen) -> Float64:
    return np.ones_like(seen.d_px)


def _yaw(seen: Seen) -> Float64:
    return np.asarray(np.radians(1.0) * px_per_radian(seen.x_px, seen.focal_px))


def _tilt(seen: Seen) -> Float64:
    return np.asarray(seen.y_px / seen.height_px)


def _focal_ratio(seen: Seen) -> Float64:
    return np.asarray(-seen.x_px / 100.0)


def _lidar_forward(seen: Seen) -> Float64:
    return np.asarray(seen.d_px**2 / seen.fB_px_m)


def _lidar_yaw(seen: Seen) -> Float64:
    moved_px = np.radians(1.0) * px_per_radian(seen.left_x_px, seen.focal_px)
    return np.asarray(seen.slope[0] * moved_px)


def _lidar_pitch(seen: Seen) -> Float64:
    moved_px = np.radians(1.0) * px_per_radian(seen.y_px, seen.focal_px)
    return np.asarray(seen.slope[1] * moved_px)


CAUSES = (
    Cause(
        "scale",
        "%",
        _scale,
        (
            "baseline or focal length {size} too long in the calibration",
            "baseline or focal length {size} too short in the calibration",
        ),
    ),
    Cause(
        "offset",
        "px",
        _offset,
        ("disparities {size} too large everywhere", "disparities {size} too small everywhere"),
    ),
    Cause(
        "yaw",
        "deg",
        _yaw,
        ("right camera turned outwards by {size}", "right camera turned inwards by {size}"),
    ),
    Cause(
        "tilt",
        "px",
        _tilt,
        (
            "disparities grow by {size} from the top to the bottom of the image",
            "disparities shrink by {size} from the top to the bottom of the image",
        ),
    ),
    Cause(
        "focal_ratio",
        "%",
        _focal_ratio,
        (
            "right focal length {size} longer than the calibration says",
            "right focal length {size} shorter than the calibration says",
        ),
    ),
    Cause(
        "lidar_forward",
        "m",
        _lidar_forward,
        ("scan placed {size} too far ahead", "scan placed {size} too near"),
    ),
    Cause(
        "lidar_yaw",
        "deg",
        _lidar_yaw,
        ("scan turned {size} too far right", "scan turned {size} too far left"),
    ),
    Cause(
        "lidar_pitch",
        "deg",
        _lidar_pitch,
        ("scan pitched {size} too far down", "scan pitched {size} too far up"),
    ),
)
