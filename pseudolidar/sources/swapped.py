"""Pictures that were stored the wrong way round."""

from __future__ import annotations

from dataclasses import replace

from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.frame import StereoFrame

# What the summary says; whoever advises to swap looks for it.
EXCHANGED = "left and right pictures are exchanged"


def swapped(source: FrameSequence[StereoFrame]) -> FrameSequence[StereoFrame]:
    """The source with the pictures of each pair exchanged; rig, truth and all else stay."""
    return ChangedSource(source, EXCHANGED, _exchanged)


def _exchanged(frame: StereoFrame) -> StereoFrame:
    return replace(frame, left=frame.right, right=frame.left)
