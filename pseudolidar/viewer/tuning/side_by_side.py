"""A frame by the present settings, and by kept ones beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from pseudolidar.errors import PseudolidarError
from pseudolidar.running.products.converted import Converted
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.moment import STEREO, Moment
from pseudolidar.viewer.reel import SourceReel

# The cloud of the kept settings, where both are shown.
KEPT_CLOUD = "stereo A"
# Which of the two is shown, or both over each other.
Shown = Literal["B", "A", "both"]
Convert = Callable[[Frame], Converted]


def side_by_side(now: Converted, kept: Converted | None, shown: Shown) -> Moment:
    """What there is to see.

    Args:
        now: by the present settings, called B.
        kept: by the kept ones, called A; None where nothing is compared.
        shown: which of both.
    """
    if kept is None:
        return Moment.of(now)
    moment = Moment.of(kept if shown == "A" else now)
    clouds, makings = dict(moment.clouds), dict(moment.makings)
    if shown == "both" and (other := Moment.of(kept).clouds.get(STEREO)) is not None:
        clouds[KEPT_CLOUD], makings[KEPT_CLOUD] = other, kept
    return replace(moment, clouds=clouds, makings=makings, compared=(kept, now))


@dataclass(frozen=True)
class TunedReel:
    """A source by settings that were tuned.

    Args:
        source: the frames by their first settings.
        now: a frame by the present settings.
        kept: by the kept ones; None where nothing is compared.
        shown: which of both.
    """

    source: SourceReel
    now: Convert
    kept: Convert | None = None
    shown: Shown = "B"

    @property
    def name(self) -> str:
        """What the source is."""
        return self.source.name

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(self.source.ids)

    @property
    def times_s(self) -> list[float]:
        """When each was taken, since the first."""
        return list(self.source.times_s)

    def load(self, index: int) -> Moment:
        """The frame by both; one that cannot be used says why."""
        try:
            frame = self.source.source.load(index)
            kept = None if self.kept is None else self.kept(frame)
            moment = side_by_side(self.now(frame), kept, self.shown)
        except PseudolidarError as error:
            return Moment(self.ids[index], index, fault=str(error))
        return replace(moment, index=index)
