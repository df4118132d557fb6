"""Another source as what frames are compared with."""

from __future__ import annotations

import logging
from pathlib import Path

from pseudolidar.errors import SourceUnknown
from pseudolidar.evaluation.map_files import is_maps
from pseudolidar.running.comparing.partners import partners_of
from pseudolidar.running.comparing.references import OtherMaps, OtherSource, Reference
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import FrameSequence
from pseudolidar.stereo.given_maps import GivenMaps, StoredSteps
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.frame import StereoFrame

_log = logging.getLogger(__name__)


def other_reference(
    text: str, source: FrameSequence[StereoFrame], matcher: StereoMatcher
) -> Reference:
    """What `text` holds: frames of a source, or disparity maps named as the frames.

    Args:
        text: path or name of the other source.
        source: whose frames are compared.
        matcher: how disparities are found where the other source has pairs.

    Raises:
        SourceUnknown: it is neither.
        SourceEmpty: none of its frames belongs to one of ours.
    """
    try:
        settings = recognise(text)
    except SourceUnknown:
        if not is_maps(Path(text)):
            raise
        steps = StoredSteps()
        maps = GivenMaps.of(Path(text), source.ids, kind="disparity", stored=steps)
        _log.info("reference: disparity maps of %s", text)
        return OtherMaps(maps, frozenset(maps.files))
    other = settings.open()
    partners = partners_of(source, other)
    _log.info("reference: %s", other.summary.line)
    _log.info("paired: %s", partners.how)
    return OtherSource(other, partners.indices, matcher)
