"""Boxes that somebody drew, brought to the ids of a source: `13` is `000013`, as in --frames."""

from __future__ import annotations

import logging
from dataclasses import replace

from pseudolidar.errors import printable
from pseudolidar.formats.regions import EVERY_FRAME
from pseudolidar.obstacles.combined import CombinedDetectors
from pseudolidar.obstacles.detector import Detector
from pseudolidar.obstacles.regions import DrawnRegions
from pseudolidar.sources.selection import FrameIds, whole
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

_log = logging.getLogger(__name__)
# Frames that are named one by one.
NAMED = 5


def detector_for(detector: Detector, source: FrameSequence[Frame]) -> Detector:
    """The detector for the frames of a source: `drawn_for` of those parts of it that were drawn.

    Args:
        detector: loaded; any other than drawn boxes stays as it is.
        source: whose frames it will be asked about, or a selection of it.
    """
    if isinstance(detector, CombinedDetectors):
        parts = tuple(detector_for(part, source) for part in detector.detectors)
        return replace(detector, detectors=parts)
    return drawn_for(detector, source) if isinstance(detector, DrawnRegions) else detector


def drawn_for(drawn: DrawnRegions, source: FrameSequence[Frame]) -> DrawnRegions:
    """Drawn boxes by the ids of a source; frames that the source does not have are warned of.

    Args:
        drawn: boxes by names of frames as somebody wrote them: ids, or numbers in them.
        source: which the boxes are drawn in, or a selection of it.
    """
    every = whole(source)
    ids = FrameIds([*every.ids, *(name for name, _ in every.refused)])
    lacking = [name for name in drawn.drawn if name != EVERY_FRAME and ids.meant(name) is None]
    if lacking:
        more = f" and {len(lacking) - NAMED} more" if len(lacking) > NAMED else ""
        has = f"; it has such as {every.ids[0]}" if every.ids else ""
        _log.warning(
            "%s",
            printable(
                f"{drawn.path}: boxes of frames that the source does not have: "
                f"{', '.join(lacking[:NAMED])}{more}{has}"
            ),
        )
    return drawn.meant_by(ids.meant)
