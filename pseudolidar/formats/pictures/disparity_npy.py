"""Disparity maps as NumPy files, as other programs leave them; pickled objects are never loaded."""

from __future__ import annotations

import io
import math
import tokenize
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import ImageFormat, ImageMissing, ImageUnreadable, LimitError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.structures.arrays import AnyArray, Float32
from pseudolidar.structures.disparity import DisparityMap

_LONGEST_HEADER = 20_000  # bytes; NumPy's own cap is 10,000 characters
# What NumPy's header parser raises on damaged bytes.
_BROKEN = (ValueError, EOFError, SyntaxError, tokenize.TokenError)


def read_disparity_npy(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> DisparityMap:
    """Read (H, W) disparities in px, NaN = none; what is not finite or not positive is none.

    Raises:
        ImageMissing, ImageUnreadable, ImageFormat, LimitError: as `read_numbers` does.
    """
    return DisparityMap(positive(read_numbers(path, limits=limits)))


def read_numbers(path: Path, *, limits: Limits) -> AnyArray:
    """(H, W) numbers of a NumPy file, as they are.

    Raises:
        ImageMissing: no such file.
        ImageUnreadable: not a NumPy file, cut off, or with objects in it.
        ImageFormat: not (H, W) of numbers.
        LimitError: more pixels than `limits.pixels`.
    """
    try:
        shape, dtype = _header(path)
        # By the header, before NumPy multiplies in 64 bits.
        if math.prod(shape) > limits.pixels:
            raise LimitError(
                f"{math.prod(shape)} pixels",
                want=f"at most {limits.pixels}",
                fix=raise_cap("pixels"),
                path=path,
            )
        if len(shape) != 2 or min(shape) < 0 or dtype.kind not in "fiu":
            found = f"{dtype} of shape {shape}"
            raise ImageFormat(found, want="(H, W) of numbers, px", path=path)
        return np.lib.format.open_memmap(path, mode="r")
    except OSError as error:
        raise ImageMissing(error.strerror or str(error), want="a .npy file", path=path) from error
    except _BROKEN as error:
        raise ImageUnreadable(str(error), want="a complete .npy file", path=path) from error


def _header(path: Path) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type, of which nothing has been made yet."""
    with path.open("rb") as file:
        start = io.BytesIO(file.read(_LONGEST_HEADER))
    version = np.lib.format.read_magic(start)
    read = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(start)
    if dtype.hasobject:
        raise ValueError("Python objects, which are never loaded")
    return shape, dtype


def positive(array: AnyArray) -> Float32:
    """The numbers in single precision, NaN for what is not finite or not positive."""
    values = array.astype(np.float32)
    return np.where(np.isfinite(values) & (values > 0), values, np.float32(np.nan))
