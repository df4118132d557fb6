"""A source whose right pictures are put right row by row, as its rig says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

from pseudolidar.errors import PseudolidarError
from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.sources.source import AnyFrame, FrameSequence, SourceSummary
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame


def with_rows_aligned(source: FrameSequence[AnyFrame]) -> FrameSequence[AnyFrame]:
    """The source with the row correction of its rig applied, where that has one."""
    if source.rig is None or source.rig.rows is None:
        return source
    return AlignedRows(source)


@dataclass(frozen=True, eq=False)
class AlignedRows(Generic[AnyFrame]):
    """A source whose pairs have their rows put right.

    `rig` keeps the row correction, as it belongs to the cameras; that of a frame has none any more,
    as its pictures need none.

    Args:
        source: with a row correction in its rig.
    """

    source: FrameSequence[AnyFrame]

    @property
    def summary(self) -> SourceSummary:
        """What it is."""
        summary = self.source.summary
        rows = None if self.source.rig is None else self.source.rig.rows
        origin = (rows and rows.origin) or "of the rig"
        return replace(
            summary, notes=(*summary.notes, f"rows of right pictures put right: {origin}")
        )

    @property
    def yields(self) -> type[AnyFrame]:
        """What its frames are."""
        return self.source.yields

    @property
    def rig(self) -> StereoRig | None:
        """That of the source."""
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

    def load(self, index: int) -> AnyFrame:
        """Frame `index` with its rows put right."""
        frame = self.source.load(index)
        if not isinstance(frame, StereoFrame) or frame.rig.rows is None:
            return frame
        aligned = rows_aligned(frame.right, frame.rig.rows)
        return replace(frame, right=aligned, rig=frame.rig.with_rows(None))
