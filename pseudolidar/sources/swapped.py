"""Pictures that were stored the wrong way round."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.source import AnyFrame, FrameSequence
from pseudolidar.structures.frame import RawPair, StereoFrame

# What the summary says; whoever advises to swap looks for it.
EXCHANGED = "left and right pictures are exchanged"


def swapped(source: FrameSequence[AnyFrame]) -> FrameSequence[AnyFrame]:
    """The source with the pictures of each pair exchanged; rig, truth and all else stay."""
    return ChangedSource(source, EXCHANGED, _exchanged)


def _exchanged(frame: Any) -> Any:
    """A pair with its pictures exchanged; anything else as it is."""
    if not isinstance(frame, StereoFrame | RawPair):
        return frame
    return replace(frame, left=frame.right, right=frame.left)
