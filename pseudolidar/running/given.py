"""Maps that stand in for a matcher: chosen, matched to the frames, and checked before the first."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import UsageError
from pseudolidar.sources.source import FrameSequence, first_middle_last, pairs_of
from pseudolidar.stereo.given_check import check_readings
from pseudolidar.stereo.given_maps import GivenMaps, MapKind, StoredSteps
from pseudolidar.structures.recorded import Frame

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class GivenSettings:
    """Which maps to take.

    Args:
        disparity: folder of disparities.
        depth: folder of depths.
        stored: steps of stored numbers.
        check: look up in the pictures whether they are right.
        sigma_px: error of the disparities, px.
    """

    disparity: Path | None
    depth: Path | None
    stored: StoredSteps
    check: bool
    sigma_px: float | None

    @property
    def text(self) -> str:
        """What is taken, "" for nothing."""
        if self.disparity is not None:
            return f"none: disparity maps of {self.disparity}"
        return "" if self.depth is None else f"none: depth maps of {self.depth}"


def given_maps(settings: GivenSettings, source: FrameSequence[Frame]) -> GivenMaps | None:
    """What reads the maps of a source, None where none are asked for.

    Raises:
        UsageError: disparity and depth, or a setting of maps without maps.
        NoPairs: the source has no pairs.
        SourceEmpty: no map belongs to a frame.
        MapScale: the maps do not fit the pictures in the scale they are read in.
    """
    place = settings.disparity or settings.depth
    if place is None:
        if settings.sigma_px is not None or settings.stored != StoredSteps():
            raise UsageError(
                "--map-scale or --sigma-px without maps", want="--disparity DIR or --depth DIR"
            )
        return None
    if settings.disparity is not None and settings.depth is not None:
        raise UsageError("both --disparity and --depth", want="one of them")
    kind: MapKind = "depth" if settings.disparity is None else "disparity"
    pairs = pairs_of(source)
    maps = GivenMaps.of(
        place, pairs.ids, kind=kind, stored=settings.stored, sigma_px=settings.sigma_px
    )
    verdict = check_readings(maps, first_middle_last(pairs)) if settings.check else None
    if verdict is not None:
        _log.info("%s", verdict.text(kind))
    return maps
