"""Before cameras are recorded: a pair is worked on, so that the first is not late."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pseudolidar.calibration.boards.eye_order import EyeOrder
from pseudolidar.errors import PseudolidarError
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.live.eye_watch import order_seen
from pseudolidar.running.nearness import Searching
from pseudolidar.running.preflight import preflight
from pseudolidar.sources.capture.live_pairs import LivePairs
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame

_log = logging.getLogger(__name__)
# How long to wait for a pair: pictures of two moments would look like a rig that is off.
PAIR_S = 3.0


@dataclass(frozen=True, eq=False)
class Specimen:
    """A source of one frame that is there already.

    Args:
        summary: of the source that it is taken from.
        frame: the frame.
    """

    summary: SourceSummary
    frame: StereoFrame = field(repr=False)
    yields: ClassVar = StereoFrame
    refused: ClassVar[tuple[tuple[str, PseudolidarError], ...]] = ()

    @property
    def rig(self) -> StereoRig:
        """Of the frame."""
        return self.frame.rig

    @property
    def ids(self) -> tuple[str, ...]:
        """Its name."""
        return (self.frame.id,)

    @property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Its time."""
        return (self.frame.timestamp_ns,)

    def load(self, index: int) -> StereoFrame:  # noqa: ARG002 - there is one
        """The frame."""
        return self.frame


def rehearsed(
    source: LivePairs[Any],
    per_frame: Callable[[Any], object],
    *,
    check: bool,
    searching: Searching | None = None,
) -> EyeOrder:
    """Work on a pair whose result nobody wants, and look whether the cameras stand as their rig.

    Loading or compiling kernels takes seconds, in which no frame would be taken. What is odd about
    the pair is logged.

    Args:
        source: the cameras.
        per_frame: what will be done to their frames.
        check: look for swapped eyes and rows that are off.
        searching: what disparities will be looked for.

    Returns:
        Which camera the pair shows to be the left one, where it is looked at.

    Raises:
        PairSwapped, NotRectified: the pairs would make no metres.
        CalibrationSizeMismatch, PairMismatch: the pictures are of another size.
    """
    frame, of_one_moment = source.specimen(within_s=PAIR_S if check else 0.0)
    if check and not of_one_moment:
        _log.warning("check: the eyes have shown no two pictures of one moment: not looked at")
    specimen = Specimen(source.summary, frame)
    wanted = check and of_one_moment
    preflight(specimen, wanted=wanted, crew=CrewPlan(1), searching=searching)
    with contextlib.suppress(PseudolidarError):  # a lens cap may be on still
        per_frame(frame)
    return order_seen(frame) if wanted else "unknown"
