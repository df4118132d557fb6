"""Right pictures put right row by row, as their rig says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.source import AnyFrame, FrameSequence
from pseudolidar.structures.frame import StereoFrame


def with_rows_aligned(source: FrameSequence[AnyFrame]) -> FrameSequence[AnyFrame]:
    """The source with the row correction of its rig applied, where that has one.

    The source's `rig` keeps the row correction, as it belongs to the cameras; that of a frame has
    none any more, as its pictures need none.
    """
    if source.rig is None or source.rig.rows is None:
        return source
    origin = source.rig.rows.origin or "of the rig"
    return ChangedSource(source, f"rows of right pictures put right: {origin}", aligned)


def aligned(frame: Any) -> Any:
    """A pair with its rows put right; anything else as it is."""
    if not isinstance(frame, StereoFrame) or frame.rig.rows is None:
        return frame
    aligned = rows_aligned(frame.right, frame.rig.rows)
    return replace(frame, right=aligned, rig=frame.rig.with_rows(None))
