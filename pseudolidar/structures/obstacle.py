"""An obstacle: something in front of the cameras with its distance, size, and error bars."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Int64, check_array
from pseudolidar.structures.box import Box3D, Detection, Track

MeasuredBy = Literal["points", "patch", "size", "track"]


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Something in the way.

    Args:
        detection: where it is in the picture, and what.
        distance_m: depth Z of its nearest face in `camera_left`.
        sigma_distance_m: one standard deviation (68 %) of that.
        box: around it, in `camera_left`, with sigma.
        sigma_heading_rad: one standard deviation of the box's heading.
        measured_by: its points; as one patch, where it is small and flat; its size and place in the
            picture where neither tells; or its track, where it is not seen and only predicted.
        confidence: 0-1, how much of what it should be was seen to be so.
        truncated: part of it lies outside of the picture.
        occluded: something nearer hides part of it.
        sigma_shared_m: the part of the error of its distance that is the same in every frame: what
            the calibration of the rig leaves.
        bound: it stands where the search for disparities ends, so that it may be nearer.
        pixels: (N,) int64 pixels that show it, as positions in the flat picture.
        track: identity and velocity, where it was followed.
    """

    detection: Detection
    distance_m: float
    sigma_distance_m: float
    box: Box3D
    sigma_heading_rad: float
    measured_by: MeasuredBy = "points"
    confidence: float = 1.0
    truncated: bool = False
    occluded: bool = False
    sigma_shared_m: float = 0.0
    bound: bool = False
    pixels: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    track: Track | None = None

    def __post_init__(self) -> None:
        check_array("Obstacle", "pixels", self.pixels, (None,), np.int64)
        if not (self.distance_m > 0 and self.sigma_distance_m > 0):
            raise StructureError(
                f"distance {self.distance_m} +- {self.sigma_distance_m} m",
                want="positive numbers",
                where=f"obstacle {self.detection.name}",
            )
        if self.box.sigma_m is None:
            raise StructureError(
                "a box without sigma", want="one with it", where=f"obstacle {self.detection.name}"
            )

    @property
    def coasts(self) -> bool:
        """Whether it is not seen in this frame, and told where its track should be."""
        return self.track is not None and self.track.state == "coasting"

    @property
    def points(self) -> int:
        """How many points it was measured by."""
        return len(self.pixels)
