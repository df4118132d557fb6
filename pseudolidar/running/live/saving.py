"""Pairs to files, to calibrate the cameras with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.formats.pictures.image import encode_png, read_image
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.product import Product
from pseudolidar.sources.bare_pairs import BarePair
from pseudolidar.structures.arrays import Image

# Folders of what the eyes see.
EYES = ("left", "right")


@dataclass(frozen=True)
class SavePair:
    """A pair to two PNGs, in the folders `left` and `right`: pure, picklable."""

    def __call__(self, pair: BarePair) -> Product:
        """Both files."""
        pictures = zip(names_of(pair.id), (pair.left, pair.right), strict=True)
        files = tuple(OutputFile.of(name, encode_png(pixels)) for name, pixels in pictures)
        return Product(files)


def names_of(pair_id: str) -> tuple[str, str]:
    """Names of both files of a pair."""
    left, right = (f"{eye}/{pair_id}.png" for eye in EYES)
    return left, right


def saved_pairs(folder: Path, ids: Iterable[str]) -> Iterator[tuple[Image, Image]]:
    """Pairs that were saved, as far as they are there.

    Raises:
        ImageUnreadable: one that is damaged.
    """
    for pair_id in ids:
        left, right = (inside(folder, name) for name in names_of(pair_id))
        if left.exists() and right.exists():
            yield read_image(left).pixels, read_image(right).pixels
