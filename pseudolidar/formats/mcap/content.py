"""What goes into a recording, as settings: light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pseudolidar.errors import UsageError

Compression = Literal["lz4", "zstd", "none"]
ProfileName = Literal["foxglove", "ros2"]
Split = Literal["none", "images,clouds"]


@dataclass(frozen=True)
class McapContent:
    """What each frame of an MCAP recording holds, and how it is packed.

    Args:
        profile: whose messages they are: Foxglove's (protobuf), or those of ROS 2 (CDR), which
            `ros2 bag play` and ROS tools take.
        images: how the pair is stored; 16-bit images are always PNG, `none` leaves the pair out.
        jpeg_quality: 0-100.
        disparity: store the disparity, 32-bit float px, NaN where there is none.
        depth: store the depth in mm, 16 bits: as raw image, whose values viewers show, or as a
            smaller and slower PNG.
        cloud: store the cloud with its columns.
        cloud_format: plain, or packed by Draco (Foxglove only; coordinates to 1 mm, slow).
        max_points: points of one message; of more those are left out whose surface is sampled most
            densely, the nearest. 0 for all of them. Files of clouds always hold all.
        pixels: with the source pixel u, v of each point: a quarter more bytes. Clouds that exist
            already keep all their columns.
        scan: store the LiDAR scan.
        labels: store the boxes of the data set.
        compression: of the recording; lz4 takes a tenth off and as long as all other packing.
        split: `images,clouds` puts pictures and clouds in files of their own, each complete in
            itself.
    """

    profile: ProfileName = "foxglove"
    images: Literal["jpeg", "png", "none"] = "jpeg"
    jpeg_quality: int = 90
    disparity: bool = True
    depth: Literal["raw", "png", "none"] = "raw"
    cloud: bool = True
    cloud_format: Literal["plain", "draco"] = "plain"
    max_points: int = 250_000
    pixels: bool = False
    scan: bool = True
    labels: bool = True
    compression: Compression = "none"
    split: Split = "none"

    def __post_init__(self) -> None:
        if not 0 <= self.jpeg_quality <= 100:
            raise UsageError(
                f"a JPEG quality of {self.jpeg_quality}", want="0 to 100", where="jpeg_quality"
            )
        if self.max_points < 0:
            raise UsageError(
                f"at most {self.max_points} points", want="0 for all, or more", where="max_points"
            )
        if self.cloud_format == "draco" and self.profile != "foxglove":
            raise UsageError(
                f"clouds packed by Draco with profile {self.profile}",
                want="profile foxglove",
                fix="ROS 2 has no message for them; leave one of the two out.",
                where="cloud_format",
            )


DEFAULT_CONTENT = McapContent()
