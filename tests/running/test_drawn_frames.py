"""Boxes that somebody drew, brought to the ids of a source."""

from __future__ import annotations

import pytest

from pseudolidar.formats.regions import EVERY_FRAME
from pseudolidar.obstacles.combined import CombinedDetectors
from pseudolidar.obstacles.labels import LabelledObjects
from pseudolidar.obstacles.regions import DrawnRegions
from pseudolidar.running.drawn_frames import detector_for, drawn_for
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.box import Detection

SOURCE = Synthetic("street", frames=3, width_px=128).open()


ONE, OTHER, THIRD = (Detection("region", (x, 0.0, x + 1, 1.0)) for x in (1.0, 2.0, 3.0))


def test_names_of_one_frame_have_their_boxes_together():
    drawn = {"1": (ONE,), SOURCE.ids[1]: (OTHER,), EVERY_FRAME: (THIRD,)}
    found = drawn_for(DrawnRegions(drawn, "boxes.csv"), SOURCE)
    assert found.boxes_of(SOURCE.ids[1]) == (THIRD, ONE, OTHER)
    assert found.boxes_of(SOURCE.ids[0]) == (THIRD,)


def test_frames_that_are_not_selected_are_there_and_others_are_named(
    caplog: pytest.LogCaptureFixture,
):
    some = select(SOURCE, FrameSelection.parse("0:1"))
    drawn = DrawnRegions({"2": (ONE,)}, "boxes.csv")
    assert drawn_for(drawn, some).boxes_of(SOURCE.ids[2]) == (ONE,)
    assert not caplog.messages
    drawn_for(DrawnRegions({str(n): (ONE,) for n in range(2, 10)}, "boxes.csv"), some)
    (said,) = caplog.messages
    assert "does not have: 3, 4, 5, 6, 7 and 2 more; it has such as" in said


def test_boxes_among_other_detectors_are_brought_too_and_these_stay():
    labels = LabelledObjects(frozenset())
    both = CombinedDetectors((labels, DrawnRegions({"1": (ONE,)}, None)), 0.5)
    found = detector_for(both, SOURCE)
    assert isinstance(found, CombinedDetectors)
    assert found.detectors[0] is labels
    assert isinstance(found.detectors[1], DrawnRegions)
    assert found.detectors[1].boxes_of(SOURCE.ids[1]) == (ONE,)
