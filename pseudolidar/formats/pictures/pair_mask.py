"""Which pixels of rectified pictures show something: two black and white PNGs beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.errors import ImageFormat
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import encode_png, read_image
from pseudolidar.structures.arrays import Bool
from pseudolidar.structures.frame import PairMask

# Folder beside the pictures, and the two files in it.
FOLDER, LEFT, RIGHT = "valid", "left.png", "right.png"
SHOWN = 255


def encode_mask(shown: Bool) -> bytes:
    """PNG of (H, W) pixels: 255 where something is shown, 0 elsewhere."""
    return encode_png(shown.astype(np.uint8) * np.uint8(SHOWN), level=9)


def read_pair_mask(folder: Path, *, limits: Limits = DEFAULT_LIMITS) -> PairMask | None:
    """The mask of the rectified pictures in `folder`, None where there is none.

    Raises:
        ImageUnreadable, ImageTruncated, LimitError: as `read_image`.
        ImageFormat: no grey pictures of black and white, or of two sizes.
    """
    files = [folder / FOLDER / name for name in (LEFT, RIGHT)]
    if not any(file.exists() for file in files):
        return None
    left, right = (_read(file, limits) for file in files)
    if left.shape != right.shape:
        raise ImageFormat(
            f"masks of {left.shape[1]}x{left.shape[0]} and {right.shape[1]}x{right.shape[0]}",
            want="the same size",
            path=folder / FOLDER,
        )
    return PairMask(left, right)


def _read(file: Path, limits: Limits) -> Bool:
    pixels = read_image(file, limits=limits).pixels
    if pixels.ndim != 2 or not np.isin(pixels, (0, SHOWN)).all():
        raise ImageFormat(
            "values that are neither black nor white",
            want=f"a grey picture of 0 and {SHOWN}",
            fix="Delete the folder, if it has nothing to do with the pictures.",
            path=file,
        )
    return np.asarray(pixels == SHOWN)
