"""Disparity maps in files, an estimate beside its reference: PNG, PFM, NPY."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    ImageFormat,
    ImageMissing,
    ImageUnreadable,
    LimitError,
    ReferenceMissing,
    SourceEmpty,
)
from pseudolidar.formats.disparity_png import read_disparity_png
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pfm import read_pfm
from pseudolidar.structures.disparity import DisparityMap


def read_disparity_npy(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> DisparityMap:
    """Read a disparity map in px from a NumPy file; what is not finite or not positive is none.

    Raises:
        ImageMissing: no such file.
        ImageUnreadable: not a NumPy file, cut off, or with objects in it.
        ImageFormat: not (H, W) of numbers.
        LimitError: more pixels than `limits.pixels`.
    """
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError as error:
        raise ImageMissing(error.strerror or str(error), want="a .npy file", path=path) from error
    except (ValueError, EOFError) as error:
        raise ImageUnreadable(str(error), want="a complete .npy file", path=path) from error
    if not isinstance(array, np.ndarray) or array.ndim != 2 or array.dtype.kind not in "fiu":
        found = f"{array.dtype} of shape {array.shape}" if isinstance(array, np.ndarray) else "npz"
        raise ImageFormat(found, want="(H, W) of numbers, px", path=path)
    if array.size > limits.pixels:
        raise LimitError(f"{array.size} pixels", want=f"at most {limits.pixels}", path=path)
    values = array.astype(np.float32)
    return DisparityMap(np.where(np.isfinite(values) & (values > 0), values, np.float32(np.nan)))


READERS: dict[str, Callable[[Path], DisparityMap]] = {
    ".png": read_disparity_png,
    ".pfm": read_pfm,
    ".npy": read_disparity_npy,
}


def read_map(path: Path) -> DisparityMap:
    """Read a disparity map by the suffix of its name."""
    if path.suffix.lower() not in READERS:
        raise ImageFormat(
            f"a file named *{path.suffix}", want=f"one of {', '.join(READERS)}", path=path
        )
    return READERS[path.suffix.lower()](path)


def is_maps(path: Path) -> bool:
    """Whether `path` is a file that may hold a disparity map, or a folder with such files."""
    return bool(_maps(path))


def paired_maps(estimate: Path, reference: Path) -> list[tuple[str, Path, Path]]:
    """Files of estimates with their references, by name; two files are a pair whatever their names.

    References without an estimate are left out.

    Raises:
        SourceEmpty: there is no estimate.
        ReferenceMissing: an estimate has no reference, or there is none at all.
    """
    estimates, references = _maps(estimate), _maps(reference)
    wanted = f"{', '.join(READERS)} files"
    if not estimates:
        raise SourceEmpty("no disparity map", want=wanted, path=estimate)
    if not references:
        raise ReferenceMissing("no disparity map", want=wanted, path=reference)
    if estimate.is_file() and reference.is_file():
        return [(estimate.stem, estimate, reference)]
    missing = [name for name in estimates if name not in references]
    if missing:
        raise ReferenceMissing(
            f"{len(missing)} estimate(s) without a reference, such as {missing[0]!r}",
            want="a file of the same name, with any suffix",
            path=reference,
        )
    return [(name, path, references[name]) for name, path in estimates.items()]


def _maps(path: Path) -> dict[str, Path]:
    files = [path] if path.is_file() else sorted(path.iterdir()) if path.is_dir() else []
    return {file.stem: file for file in files if file.suffix.lower() in READERS}
