"""Which pixels of a picture are there at all, by its alpha channel."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_header
from pseudolidar.formats.whole_read import read_whole
from pseudolidar.structures.arrays import Bool


def read_alpha(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> Bool | None:
    """(H, W) pixels that are at least half opaque; None where there is no alpha channel.

    Raises:
        ImageMissing, ImageUnreadable, ImageTruncated, ImageFormat, LimitError: see `read_image`.
    """
    if not read_header(path, limits=limits).alpha:
        return None
    import cv2

    data = np.frombuffer(read_whole(path), np.uint8)
    pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 3 or pixels.shape[2] not in (2, 4):
        return None
    half = 2 ** (8 * pixels.dtype.itemsize - 1)
    return np.asarray(pixels[:, :, -1] >= half)
