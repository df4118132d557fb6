"""What goes into a recording, as settings: light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pseudolidar.errors import UsageError

Compression = Literal["lz4", "zstd", "none"]


@dataclass(frozen=True)
class McapContent:
    """What each frame of an MCAP recording holds, and how it is packed.

    Args:
        images: how the pair is stored; 16-bit images are always PNG, `none` leaves the pair out.
        jpeg_quality: 0-100.
        disparity: store the disparity, 32-bit float px, NaN where there is none.
        depth: store the depth in mm, 16 bits: as raw image, whose values viewers show, or as a
            smaller and slower PNG.
        cloud: store the stereo cloud with its columns.
        pixels: with the source pixel u, v of each point: a quarter more bytes.
        scan: store the LiDAR scan.
        labels: store the boxes of the data set.
        compression: of the recording; lz4 takes a tenth off and as long as all other packing.
    """

    images: Literal["jpeg", "png", "none"] = "jpeg"
    jpeg_quality: int = 90
    disparity: bool = True
    depth: Literal["raw", "png", "none"] = "raw"
    cloud: bool = True
    pixels: bool = False
    scan: bool = True
    labels: bool = True
    compression: Compression = "none"

    def __post_init__(self) -> None:
        if not 0 <= self.jpeg_quality <= 100:
            raise UsageError(
                f"a JPEG quality of {self.jpeg_quality}", want="0 to 100", where="jpeg_quality"
            )


DEFAULT_CONTENT = McapContent()
