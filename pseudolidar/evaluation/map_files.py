"""Disparity maps in files, an estimate beside its reference: PNG, PFM, NPY."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pseudolidar.errors import ImageFormat, ReferenceMissing, SourceEmpty
from pseudolidar.formats.pictures.disparity_npy import read_disparity_npy
from pseudolidar.formats.pictures.disparity_png import read_disparity_png
from pseudolidar.formats.pictures.pfm import read_pfm
from pseudolidar.structures.disparity import DisparityMap

READERS: dict[str, Callable[[Path], DisparityMap]] = {
    ".png": read_disparity_png,
    ".pfm": read_pfm,
    ".npy": read_disparity_npy,
}


def read_map(path: Path) -> DisparityMap:
    """Read a disparity map by the suffix of its name.

    Raises:
        ImageFormat: another suffix than those of `READERS`.
        ImageMissing, ImageUnreadable, ImageTruncated, LimitError: as its reader says.
    """
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
