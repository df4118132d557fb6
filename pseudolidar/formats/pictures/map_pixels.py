"""Maps of numbers in files of any kind: 16-bit PNG, PFM, NPY, as they are stored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import ImageFormat
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.disparity_npy import positive, read_numbers
from pseudolidar.formats.pictures.pfm import read_pfm
from pseudolidar.formats.pictures.png16 import read_steps
from pseudolidar.structures.arrays import Float32


@dataclass(frozen=True, eq=False)
class MapPixels:
    """A map as it is stored.

    Args:
        values: (H, W) float32, NaN where there is none: 0, negative, not finite.
        whole: whether the file holds integers, whose unit must be known.
    """

    values: Float32
    whole: bool


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
    return MapPixels(read_steps(path, limits=limits), whole=True)


def _pfm(path: Path, limits: Limits) -> MapPixels:
    return MapPixels(read_pfm(path, limits=limits).values, whole=False)


def _npy(path: Path, limits: Limits) -> MapPixels:
    numbers = read_numbers(path, limits=limits)
    return MapPixels(positive(numbers), whole=numbers.dtype.kind in "iu")


READERS: dict[str, Callable[[Path, Limits], MapPixels]] = {
    ".png": _png,
    ".pfm": _pfm,
    ".npy": _npy,
}
