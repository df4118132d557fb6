"""What fused odometry looks at in a frame, and where it stood when vision saw something last."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.mapping.fused_path import Place
from pseudolidar.mapping.patches import Patches, find_patches
from pseudolidar.mapping.scan_witness import ScanPlanes
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Nearer patches enter the map, m; so many of a frame say what all of them say.
MAPPED_M, MOST_PATCHES = 25.0, 1500


@dataclass(frozen=True, eq=False)
class FusedSight:
    """What a frame shows, made ready.

    Args:
        timestamp_ns: when it was taken.
        grey: (H, W) its left picture.
        patches: of its disparities.
        scan: its planes; None without.
    """

    timestamp_ns: int
    grey: UInt8
    patches: Patches
    scan: ScanPlanes | None

    @classmethod
    def of(
        cls, frame: StereoFrame, disparity: DisparityMap, rig: StereoRig, scan: ScanPlanes | None
    ) -> Self:
        """Look for patches; the rig's correction is taken off."""
        grey = grey8_pair(frame.left, frame.right)[0]
        return cls(frame.timestamp_ns, grey, find_patches(disparity, rig), scan)

    @property
    def some(self) -> Patches:
        """Of the patches as many as are looked at."""
        return self.patches[:: max(1, len(self.patches) // MOST_PATCHES)]

    @property
    def mapped_xyz(self) -> Float64:
        """(N, 3) centres of those that enter the map."""
        return self.patches.xyz[self.patches.depth_m < MAPPED_M]


@dataclass(frozen=True, eq=False)
class Anchor:
    """The last frame that vision placed.

    Args:
        seen: what it shows.
        place: on the fused path.
        piece: of vision's path.
        frame: of that piece.
    """

    seen: FusedSight
    place: Place
    piece: int
    frame: int
