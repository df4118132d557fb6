"""What every source over another one has in common: the frames are those of the other."""

from __future__ import annotations

from typing import Any

from pseudolidar.errors import PseudolidarError
from pseudolidar.sources.source import FrameSequence


class SourceOver:
    """A source whose frames are, one by one, those of `source`: same names, times and refusals."""

    source: FrameSequence[Any]

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
