"""Which detector somebody in a browser asks for."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pseudolidar.errors import UsageError
from pseudolidar.obstacles.cloud import Cloud
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.corridor import Corridor
from pseudolidar.obstacles.detector import Detector
from pseudolidar.obstacles.detectors import AnyDetector
from pseudolidar.obstacles.hues import Hues
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.regions import Boxes, Regions
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.obstacles.within import Band, Range
from pseudolidar.running.settings_schema import choice_name
from pseudolidar.viewer.objects.teller import Wish

NONE, OF_RUN = "none", "of the run"
# What detectors that need words are given at first.
USUAL = {"range": "2-20", "colour": "red", "regions": "480,180,620,260"}
_NUMBERS = re.compile(r"[\d.,+\- ]{1,80}")


def kinds(*, of_run: bool, given: AnyDetector | None) -> tuple[str, ...]:
    """Detectors to choose from.

    Args:
        of_run: whether a run has found objects already.
        given: the one that the viewer was started with.
    """
    first = [OF_RUN] if of_run else []
    return (*first, NONE, *([] if given is None else [given_name(given)]), *_BY_WORDS)


def given_name(given: AnyDetector) -> str:
    """What the detector is called that the viewer was started with."""
    return f"{choice_name(type(given))}, as started"


def detector_of(kind: str, text: str, given: AnyDetector | None) -> AnyDetector | None:
    """The detector of a kind, with the words that its flag takes.

    Args:
        kind: one of `kinds`.
        text: hues, distances, or a box in px.
        given: the one that the viewer was started with.

    Raises:
        UsageError: the words mean nothing to it.
    """
    if given is not None and kind == given_name(given):
        return given
    made = _BY_WORDS.get(kind)
    return None if made is None else made(text)


def _regions(text: str) -> Regions:
    # Anything else would be taken for the path of a file.
    if not _NUMBERS.fullmatch(text):
        raise UsageError(f"{text!r}", want="LEFT,TOP,RIGHT,BOTTOM in px")
    return Regions(Boxes.parse(text))


# What words make of each kind. A browser names no files: detectors that read one are not among
# these, and come with the command that started the viewer.
_BY_WORDS: Mapping[str, Callable[[str], AnyDetector]] = {
    "labels": lambda _text: Labels(),
    "regions": _regions,
    "colour": lambda text: Colour(Hues.parse(text), most=5),
    "range": lambda text: Range(Band.parse(text)),
    "cloud": lambda _text: Cloud(),
}


def _as_it_is(detector: Detector) -> Detector:
    return detector


@dataclass(frozen=True)
class Asked:
    """What is wanted from the start.

    Args:
        detector: the one of the command line, which may name files.
        corridor: the one of the command line.
        placed: fits a loaded detector to the frames that are shown, such as boxes that somebody
            drew to their ids.
    """

    detector: AnyDetector | None = None
    corridor: Corridor | None = None
    placed: Callable[[Detector], Detector] = _as_it_is

    def kind(self, *, of_run: bool) -> str:
        """The detector that is chosen at first."""
        if self.detector is not None:
            return given_name(self.detector)
        return OF_RUN if of_run else NONE

    def loaded(self, detector: AnyDetector) -> Detector:
        """The detector of some settings, with everything heavy loaded.

        Raises:
            PseudolidarError: a file of the settings is absent, or is no such file.
        """
        return self.placed(detector.load())

    def wish(self, *, of_run: bool) -> Wish:
        """What is wanted of frames at first, with everything heavy loaded."""
        detect = None if self.detector is None else self.loaded(self.detector)
        return Wish(self.kind(of_run=of_run) == OF_RUN, detect, self.corridor, Tracker())


NOTHING_ASKED = Asked()
