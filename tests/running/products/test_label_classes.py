"""Warnings of odd classes of labels."""

from __future__ import annotations

from pathlib import Path

from pseudolidar.obstacles.labels import Labels
from pseudolidar.obstacles.template import Template
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.products.label_classes import LABELLED, class_warnings

RECORDS = [
    FrameRecord("0", 0, figures={LABELLED: ["Car", "Unicorn"]}),
    FrameRecord("1", 1, figures={LABELLED: ["Cyclist"]}),
    FrameRecord("2", 2, figures={}),
]


def test_each_class_is_named_once():
    detectors = [Labels(("car", "Cra", "Cra")), Labels(("Cra", "Tram")), None]
    assert class_warnings(detectors, RECORDS) == [
        "labels: no frame has the class Cra; there are Car, Cyclist, Unicorn",
        "labels: no frame has the class Tram; there are Car, Cyclist, Unicorn",
        "labels: classes that KITTI does not have: Unicorn",
    ]


def test_classes_that_nobody_labelled_are_said_to_be_none():
    frames = [FrameRecord("0", 0, figures={LABELLED: []})]
    (line,) = class_warnings([Labels(("Car",))], frames)
    assert line.endswith("Car; there are none")


def test_nothing_is_odd_where_labels_were_not_asked():
    assert class_warnings([Template(Path("bike.png")), None], RECORDS) == []
    assert class_warnings([Labels(("Cra",))], RECORDS[2:]) == []
    assert class_warnings([Labels()], RECORDS[1:]) == []
