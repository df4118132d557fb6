"""KITTI's depth PNG: uint16, metres x 256, 0 = none."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.png16 import (
    LARGEST_STEP,
    STEPS_PER_UNIT,
    encode_fixed_point,
    read_fixed_point,
)
from pseudolidar.structures.disparity import DepthMap

LARGEST_DEPTH_M = LARGEST_STEP / STEPS_PER_UNIT


def write_depth_png(path: Path, depth: DepthMap) -> None:
    """Write depths, without their sigma; beyond 255.996 m there are none.

    Raises:
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_depth_png(depth))


def read_depth_png(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> DepthMap:
    """Read depths in metres, NaN = none, to 1/256 m.

    The scale is KITTI's; millimetres (ROS, RealSense) or 1/5000 m (TUM) look the same.

    Raises:
        ImageMissing, ImageUnreadable, ImageTruncated, LimitError: it cannot be read.
        ImageFormat: not 16 bits, or colours.
    """
    return DepthMap(read_fixed_point(path, limits=limits))


def encode_depth_png(depth: DepthMap) -> bytes:
    """The bytes of the PNG: depths to 1/256 m; beyond 255.996 m there are none."""
    values = depth.values
    return encode_fixed_point(np.where(values <= LARGEST_DEPTH_M, values, np.float32(np.nan)))
