"""16-bit grey PNG of KITTI's fixed-point maps: value = metres or pixels x 256, 0 = none."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np

from pseudolidar.errors import ImageFormat
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.image import encode_png, read_image
from pseudolidar.structures.arrays import Float32

# Steps of one pixel of disparity or one metre of depth (KITTI devkits, stereo and depth).
STEPS_PER_UNIT = 256
LARGEST_STEP = 65535


def encode_fixed_point(values: Float32) -> bytes:
    """PNG of (H, W) values; those that are not finite or not positive are none.

    A value that would round to 0 becomes the smallest step, so that it stays one. The caller has
    taken care of values above 255.998.
    """
    steps = np.clip(np.rint(values * np.float32(STEPS_PER_UNIT)), 1, LARGEST_STEP)
    steps[~((values > 0) & np.isfinite(values))] = 0
    return encode_png(steps.astype(np.uint16))


def read_fixed_point(path: Path, *, limits: Limits) -> Float32:
    """(H, W) float32 values of a PNG, NaN where there is none. Raises as `read_steps`."""
    return cast("Float32", read_steps(path, limits=limits) / STEPS_PER_UNIT)


def read_steps(path: Path, *, limits: Limits) -> Float32:
    """(H, W) float32 stored integers of a PNG, NaN where they are 0.

    Raises:
        ImageMissing, ImageUnreadable, ImageTruncated, LimitError: as `read_image` does.
        ImageFormat: 8 bits or colours, which never hold metres.
    """
    stored = read_image(path, limits=limits).pixels
    if stored.dtype != np.uint16 or stored.ndim != 2:
        channels = 1 if stored.ndim == 2 else stored.shape[2]
        raise ImageFormat(
            f"{channels} channel(s) of {stored.dtype}",
            want="one channel of 16 bits",
            fix="An 8-bit or colour picture of a map is only to look at: give the original.",
            path=path,
        )
    steps = stored.astype(np.float32)
    steps[stored == 0] = np.nan
    return steps
