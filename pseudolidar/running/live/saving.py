"""Pairs to files, to calibrate the cameras with."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.product import Product
from pseudolidar.sources.capture.eyes import BarePair


@dataclass(frozen=True)
class SavePair:
    """A pair to two PNGs, in the folders `left` and `right`: pure, picklable."""

    def __call__(self, pair: BarePair) -> Product:
        """Both files."""
        from pseudolidar.formats.pictures.image import encode_png

        eyes = {"left": pair.left, "right": pair.right}
        files = tuple(
            OutputFile.of(f"{eye}/{pair.id}.png", encode_png(pixels))
            for eye, pixels in eyes.items()
        )
        return Product(files, figures={"timestamp_ns": str(pair.timestamp_ns)})
