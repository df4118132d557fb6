"""What every family of detectors is."""

from __future__ import annotations

from typing import Protocol

from pseudolidar.obstacles.networks.answer import Answer, Candidates
from pseudolidar.obstacles.networks.layout import DetectorLayout, FamilyName


class Family(Protocol):
    """How boxes and scores lie in the outputs of some detectors."""

    @property
    def name(self) -> FamilyName:
        """As in `DetectorLayout.family`."""

    @property
    def form(self) -> str:
        """The outputs, for people."""

    @property
    def overlapping(self) -> bool:
        """One object has several boxes, of which the best must be chosen."""

    def told(self, answer: Answer, known: DetectorLayout) -> DetectorLayout | None:
        """What the answer says of the layout, if it is of this family; None if it is not."""

    def read(self, answer: Answer, layout: DetectorLayout, threshold: float) -> Candidates:
        """The objects of an answer whose score is at least the threshold.

        Raises:
            ModelOutput: the answer means nothing.
        """
