"""Maps of numbers in files of any kind: 16-bit PNG, PFM, NPY, as they are stored."""

from __future__ import annotations

import tokenize
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from pseudolidar.errors import ImageFormat, ImageMissing, ImageUnreadable, LimitError
from pseudolidar.formats.image import read_image
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pfm import read_pfm
from pseudolidar.structures.arrays import Float32

# What NumPy's header parser raises on damaged bytes.
_BROKEN_NPY = (ValueError, EOFError, SyntaxError, tokenize.TokenError)


@dataclass(frozen=True, eq=False)
class MapPixels:
    """A map as it is stored.

    Args:
        values: (H, W) float32, NaN where there is none: 0, negative, not finite.
        whole: whether the file holds integers, whose unit must be known.
        dropped: pixels that were negative or not finite.
    """

    values: Float32
    whole: bool
    dropped: int = 0


def read_map_pixels(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> MapPixels:
    """Read a map by the suffix of its name.

    Raises:
        ImageMissing: no such file.
        ImageFormat: 8 bits or colours, which never hold metres; another suffix; not (H, W).
        ImageUnreadable, ImageTruncated, LimitError: as the reader of its format says.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ImageFormat(
            f"a file named *{path.suffix}", want=f"one of {', '.join(READERS)}", path=path
        )
    return reader(path, limits)


def _png(path: Path, limits: Limits) -> MapPixels:
    stored = read_image(path, limits=limits).pixels
    if stored.dtype != np.uint16 or stored.ndim != 2:
        channels = 1 if stored.ndim == 2 else stored.shape[2]
        raise ImageFormat(
            f"{channels} channel(s) of {stored.dtype}",
            want="one channel of 16 bits",
            fix="An 8-bit or colour picture of a map is only to look at: give the original.",
            path=path,
        )
    values = stored.astype(np.float32)
    values[stored == 0] = np.nan
    return MapPixels(values, whole=True)


def _pfm(path: Path, limits: Limits) -> MapPixels:
    return MapPixels(read_pfm(path, limits=limits).values, whole=False)


def _npy(path: Path, limits: Limits) -> MapPixels:
    try:
        array = np.lib.format.open_memmap(path, mode="r")
    except OSError as error:
        raise ImageMissing(error.strerror or str(error), want="a .npy file", path=path) from error
    except _BROKEN_NPY as error:
        raise ImageUnreadable(str(error), want="a complete .npy file", path=path) from error
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        found = f"{array.dtype} of shape {array.shape}"
        raise ImageFormat(found, want="(H, W) of numbers", path=path)
    if array.size > limits.pixels:
        raise LimitError(f"{array.size} pixels", want=f"at most {limits.pixels}", path=path)
    values = array.astype(np.float32)
    known = np.isfinite(values) & (values > 0)
    dropped = int(np.count_nonzero(~known & (values != 0)))
    values = cast("Float32", np.where(known, values, np.float32(np.nan)))
    return MapPixels(values, array.dtype.kind in "iu", dropped)


READERS: dict[str, Callable[[Path, Limits], MapPixels]] = {
    ".png": _png,
    ".pfm": _pfm,
    ".npy": _npy,
}
