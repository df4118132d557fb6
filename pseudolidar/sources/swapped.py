"""A source whose two pictures were stored the wrong way round."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from pseudolidar.errors import PseudolidarError
from pseudolidar.sources.source import FrameSource, SourceSummary
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame

# What the summary says; whoever advises to swap looks for it.
EXCHANGED = "left and right pictures are exchanged"


@dataclass(frozen=True, eq=False)
class SwappedSource:
    """A source with the pictures of each pair exchanged; rig, truth and all else stay.

    Args:
        source: the source as it is stored.
    """

    source: FrameSource
    yields: ClassVar = StereoFrame

    @property
    def summary(self) -> SourceSummary:
        """What it is."""
        summary = self.source.summary
        return replace(summary, notes=(*summary.notes, EXCHANGED))

    @property
    def rig(self) -> StereoRig:
        """Rig of the source."""
        return self.source.rig

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the frames."""
        return self.source.ids

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Times of the frames."""
        return self.source.timestamps_ns

    @property
    def refused(self) -> tuple[tuple[str, PseudolidarError], ...]:
        """Frames known to be unusable."""
        return self.source.refused

    def load(self, index: int) -> StereoFrame:
        """Frame `index` with left and right exchanged."""
        frame = self.source.load(index)
        return replace(frame, left=frame.right, right=frame.left)
