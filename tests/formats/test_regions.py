"""Boxes that somebody drew: CSV and JSON, and everything that is no box."""

from __future__ import annotations

from pathlib import Path

import pytest

from pseudolidar.errors import LabelError, UsageError
from pseudolidar.formats.regions import EVERY_FRAME, read_regions
from pseudolidar.obstacles.regions import Boxes, Regions
from tests.obstacles.scene import sight

CSV = "frame, left, top, right, bottom, class, score\n000013,1,2,30.5,40,Car,0.5\n,5,6,7,8,,\n"
JSON = """[{"frame": "000013", "left": 1, "top": 2, "right": 30.5, "bottom": 40, "class": "Car",
"score": 0.5}, {"left": 5, "top": 6, "right": 7, "bottom": 8}]"""


def written(folder: Path, text: str, name: str = "boxes.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(("text", "name"), [(CSV, "boxes.csv"), (JSON, "boxes.json")])
def test_boxes_are_read_by_frame(tmp_path: Path, text: str, name: str) -> None:
    found = read_regions(written(tmp_path, text, name))
    assert list(found) == ["000013", EVERY_FRAME]
    (car,) = found["000013"]
    assert (car.name, car.box_px, car.score) == ("Car", (1.0, 2.0, 30.5, 40.0), 0.5)
    (other,) = found[EVERY_FRAME]
    assert (other.name, other.box_px, other.score) == ("region", (5.0, 6.0, 7.0, 8.0), 1.0)


def test_frame_0_is_a_frame(tmp_path: Path) -> None:
    box = '"left": 1, "top": 2, "right": 3, "bottom": 4'
    text = f'[{{"frame": 0, {box}}}, {{"frame": null, {box}}}, {{"frame": "", {box}}}]'
    found = read_regions(written(tmp_path, text, "boxes.json"))
    assert {frame: len(boxes) for frame, boxes in found.items()} == {"0": 1, EVERY_FRAME: 2}


HEAD = "left,top,right,bottom\n"


@pytest.mark.parametrize(
    ("text", "where", "got"),
    [
        ("", "line 1", "nothing"),
        ("left,top,right\n1,2,3\n", "line 1", "the names left, top, right"),
        ("left,top,right,bottom,colour\n1,2,3,4,red\n", "line 1", "colour"),
        ("left,left,top,right,bottom\n1,1,2,3,4\n", "line 1", "left, left"),
        (HEAD + "1,2,3\n", "line 2", "3 values"),
        (HEAD + "1,2,3,4,5\n", "line 2", "5 values"),
        (HEAD + "1,2,x,4\n", "line 2", "right 'x'"),
        (HEAD + "1,2,nan,4\n", "line 2", "right 'nan'"),
        (HEAD + "1,2,,4\n", "line 2", "right nothing"),
        (HEAD + "1,2,3,4\n9,2,3,4\n", "line 3", "box 9,2,3,4"),
        ("score," + HEAD + "1.5,1,2,3,4\n", "line 2", "score 1.5"),
        ("[1]", "object 0", "'1'"),
        ("{}", "line 1", "a JSON dict"),
        ("[{", "line 1", "no JSON"),
        ('[{"left": 1, "top": 2, "right": true, "bottom": 4}]', "object 0", "right 'True'"),
        ('[{"left": 1, "top": 2, "right": 1e999, "bottom": 4}]', "object 0", "right 'inf'"),
        ("[" * 5000, "line 1", "no JSON"),
    ],
)
def test_what_is_no_box_is_named_by_its_place(
    tmp_path: Path, text: str, where: str, got: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(LabelError) as raised:
        read_regions(path)
    assert raised.value.path == str(path)
    assert raised.value.where == where
    assert got in raised.value.got
    assert raised.value.want


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LabelError, match=r"none\.csv"):
        Regions(Boxes.parse(str(tmp_path / "none.csv"))).load()


def test_a_typed_box_is_of_every_frame_and_takes_a_class() -> None:
    boxes = Boxes.parse("10, 20,50,60.5")
    assert str(boxes) == "10,20,50,60.5"
    (found,) = Regions(boxes, "Car").load()(sight(()))
    assert (found.name, found.box_px) == ("Car", (10.0, 20.0, 50.0, 60.5))
    for text in ("1,2,3", "5,2,3,4", "1,2,3,4,5"):
        with pytest.raises(UsageError, match="LEFT,TOP,RIGHT,BOTTOM"):
            Boxes.parse(text)


def test_a_box_outside_of_the_picture_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "frame," + HEAD + "frame,700,2,800,4\n")
    with pytest.raises(LabelError, match="in the picture of 640x240") as raised:
        Regions(Boxes.parse(str(path))).load()(sight(()))
    assert (raised.value.path, raised.value.where) == (str(path), "frame frame")
