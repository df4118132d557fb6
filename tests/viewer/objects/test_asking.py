"""Detectors that somebody in a browser may ask for."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import get_args

import pytest

from pseudolidar.errors import UsageError
from pseudolidar.obstacles.cloud import Cloud
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.detectors import AnyDetector
from pseudolidar.obstacles.hues import Hues
from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.regions import Boxes, Regions
from pseudolidar.obstacles.template import Template
from pseudolidar.obstacles.within import Band, Range
from pseudolidar.running.drawn_frames import detector_for
from pseudolidar.running.settings_schema import choice_name
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.viewer.objects.asking import USUAL, Asked, detector_of, kinds

GIVEN = Template(Path("bike.png"))


def test_detectors_that_read_files_come_with_the_command_alone():
    assert kinds(of_run=False, given=None) == (
        "none",
        "labels",
        "regions",
        "colour",
        "range",
        "cloud",
    )
    with_given = kinds(of_run=True, given=GIVEN)
    assert with_given[:3] == ("of the run", "none", "template, as started")
    assert detector_of("template, as started", "", GIVEN) is GIVEN
    assert detector_of("template, as started", "", None) is None
    assert detector_of("template", "other.png", GIVEN) is None


def test_every_detector_is_asked_for_by_words_or_comes_with_the_command():
    names = {choice_name(one) for one in get_args(AnyDetector)}
    assert {*kinds(of_run=False, given=None)} == {"none", *names} - {"template", "onnx"}


def test_words_are_those_of_the_flags():
    assert detector_of("none", "", None) is None
    assert detector_of("of the run", "", None) is None
    assert detector_of("labels", "", None) == Labels()
    assert detector_of("cloud", "", None) == Cloud()
    assert detector_of("range", "2-10", None) == Range(Band(2, 10))
    assert detector_of("colour", "blue", None) == Colour(Hues(200, 265), most=5)
    box = Boxes(box_px=(1, 2, 30.5, 40))
    assert detector_of("regions", "1, 2,30.5,40", None) == Regions(box)


@pytest.mark.parametrize("kind", USUAL)
def test_the_words_of_the_start_are_understood(kind: str):
    assert detector_of(kind, USUAL[kind], None) is not None


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("range", "10-2"),
        ("colour", "loud"),
        ("regions", "/etc/passwd"),
        ("regions", "1,2,3"),
        ("regions", "1,2,3,pyproject.toml"),
        ("regions", "1" * 90),
        ("range", ""),
    ],
)
def test_words_that_mean_nothing_are_refused(kind: str, text: str):
    with pytest.raises(UsageError):
        detector_of(kind, text, None)


def test_drawn_boxes_find_the_frames_that_are_shown(tmp_path: Path, caplog):
    """By their numbers, as --frames does, whether the command or the page asks for them."""
    boxes = tmp_path / "boxes.csv"
    boxes.write_text("frame,left,top,right,bottom\n1,1,2,3,4\n77,1,2,3,4\n")
    given = Regions(Boxes(boxes))
    source = Synthetic("street", frames=2, width_px=128).open()
    asked = Asked(given, placed=partial(detector_for, source=source))
    for detect in (asked.wish(of_run=False).detect, asked.loaded(given)):
        assert [len(detect.boxes_of(name)) for name in source.ids] == [0, 1]
    assert "does not have: 77" in caplog.text
