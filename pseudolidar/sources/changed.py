"""A source whose frames are changed as they load; names, times and rig stay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic

from pseudolidar.sources.over import SourceOver
from pseudolidar.sources.source import AnyFrame, FrameSequence, SourceSummary
from pseudolidar.structures.camera import StereoRig


@dataclass(frozen=True, eq=False)
class ChangedSource(SourceOver, Generic[AnyFrame]):
    """Another source, each frame of it passed through a function.

    Args:
        source: where the frames come from.
        note: what is done to them, for people.
        change: pure, picklable; a frame to one of the same kind.
    """

    source: FrameSequence[AnyFrame]
    note: str
    change: Callable[[AnyFrame], AnyFrame]

    @property
    def summary(self) -> SourceSummary:
        """What it is, and what is done to it."""
        summary = self.source.summary
        return replace(summary, notes=(*summary.notes, self.note))

    @property
    def yields(self) -> type[AnyFrame]:
        """What its frames are."""
        return self.source.yields

    @property
    def rig(self) -> StereoRig | None:
        """That of the source."""
        return self.source.rig

    def load(self, index: int) -> AnyFrame:
        """Frame `index`, changed."""
        return self.change(self.source.load(index))
