"""What every detector is: a sight in, the objects in its picture out."""

from __future__ import annotations

from typing import Protocol

from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.box import Detection


class Detector(Protocol):
    """A loaded detector; safe to call from several threads at once."""

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """The objects of one frame, in a fixed order; none is a valid result.

        Boxes lie inside the picture. An object that is known by its pixels has a mask.
        """


class DetectorSettings(Protocol):
    """Settings of a detector."""

    def load(self) -> Detector:
        """The detector, with everything heavy loaded."""
