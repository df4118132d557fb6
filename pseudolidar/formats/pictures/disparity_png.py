"""KITTI's disparity PNG: uint16, disparity x 256, 0 = none."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.png16 import (
    LARGEST_STEP,
    STEPS_PER_UNIT,
    encode_fixed_point,
    read_fixed_point,
)
from pseudolidar.structures.disparity import DisparityMap

LARGEST_DISPARITY_PX = LARGEST_STEP / STEPS_PER_UNIT


def write_disparity_png(path: Path, disparity: DisparityMap) -> None:
    """Write disparities, without their sigma.

    Raises:
        StructureError: a disparity that the format cannot hold.
        OutputError: the file cannot be written.
    """
    write_atomic(path, encode_disparity_png(disparity))


def read_disparity_png(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> DisparityMap:
    """Read disparities in px, NaN = none, to 1/256 px.

    Raises:
        ImageMissing, ImageUnreadable, ImageTruncated, LimitError: it cannot be read.
        ImageFormat: not 16 bits, or colours.
    """
    return DisparityMap(read_fixed_point(path, limits=limits))


def encode_disparity_png(disparity: DisparityMap) -> bytes:
    """The bytes of the PNG: disparities to 1/256 px, at least one step where there is one.

    Raises:
        StructureError: a disparity of 256 px or more: left out, the nearest things would vanish.
    """
    values = disparity.values
    largest = float(np.max(values, initial=0.0, where=np.isfinite(values)))
    if largest * STEPS_PER_UNIT > LARGEST_STEP + 0.5:
        raise StructureError(
            f"a disparity of {largest:.1f} px",
            want=f"at most {LARGEST_DISPARITY_PX:.3f} in a KITTI PNG",
            fix="Write PFM instead.",
            where="encode_disparity_png",
        )
    return encode_fixed_point(values)
