"""Another source as what frames are compared with."""

from __future__ import annotations

import logging
from pathlib import Path

from pseudolidar.errors import NoPairs, SourceUnknown
from pseudolidar.evaluation.map_files import is_maps
from pseudolidar.running.comparing.partners import partners_of
from pseudolidar.running.comparing.references import OtherMaps, OtherSource, Reference
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import FrameSequence, clouds_of
from pseudolidar.stereo.given_maps import GivenMaps, StoredSteps
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.recorded import Frame

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
        NoPairs: it has pairs of several rigs.
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
    other = opened_with_rig(settings, None)
    if other.yields is BodyFrame:
        raise NoPairs(
            f"a reference of several pairs: {other.summary.line}",
            want="pairs of one rig, clouds, or depths",
            fix="Make clouds of it first, `pseudolidar convert BODY OUT --to mcap`, and compare "
            "with the recording in OUT; or give the folder of one pair.",
            path=text,
        )
    return _paired(source, other, matcher)


def other_scans(text: str, source: FrameSequence[StereoFrame]) -> OtherSource:
    """The clouds of another source as the scans of pairs.

    Raises:
        SourceUnknown, NoClouds: it has none.
        SourceEmpty: none of its frames belongs to one of ours.
    """
    return _paired(source, clouds_of(recognise(text).open()), None)


def _paired(
    source: FrameSequence[StereoFrame], other: FrameSequence[Frame], matcher: StereoMatcher | None
) -> OtherSource:
    partners = partners_of(source, other)
    _log.info("reference: %s", other.summary.line)
    _log.info("paired: %s", partners.how)
    return OtherSource(other, partners.indices, matcher)
