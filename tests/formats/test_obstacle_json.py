"""Obstacles as lines of JSON: everything comes back, the form is described, faults are named."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from typing import get_args

import jsonschema
import numpy as np
import pytest

from pseudolidar.errors import LabelError
from pseudolidar.formats.obstacle_json import obstacle_fields, obstacle_schema, read_obstacles
from pseudolidar.running.products.obstacle_tables import encode_csv, encode_jsonl
from pseudolidar.structures.obstacle import MeasuredBy
from tests.formats.made_obstacles import car, light


def fields() -> list[dict]:
    made = {"000001": (car(), light()), "000002": (car(track=False),)}
    return [
        obstacle_fields(obstacle, frame=frame, time_s=0.1, number=number)
        for frame, obstacles in made.items()
        for number, obstacle in enumerate(obstacles, start=1)
    ]


def test_every_number_of_obstacle_and_track_comes_back(tmp_path) -> None:
    path = tmp_path / "obstacles.jsonl"
    path.write_bytes(encode_jsonl(fields()))
    found = read_obstacles(path)
    assert [(frame, len(obstacles)) for frame, obstacles in found.items()] == [
        ("000001", 2),
        ("000002", 1),
    ]
    again = [
        obstacle_fields(obstacle, frame=frame, time_s=0.1, number=number)
        for frame, obstacles in found.items()
        for number, obstacle in enumerate(obstacles, start=1)
    ]
    assert again == [one | {"points": 0} for one in fields()]  # its pixels are not in the file
    track = found["000001"][0].track
    assert track is not None
    assert (track.track_id, track.contact) == (7, car().track.contact)
    np.testing.assert_array_equal(track.velocity_m_s, [0.5, 0.0, -8.25])


def test_the_schema_holds_for_what_is_written_and_refuses_other_things() -> None:
    jsonschema.Draft202012Validator.check_schema(obstacle_schema())
    validator = jsonschema.Draft202012Validator(obstacle_schema())
    described = obstacle_schema()["properties"]
    for one in fields():
        validator.validate(json.loads(json.dumps(one, allow_nan=False)))
        assert set(one) <= set(described)
    first = fields()[0]
    for broken in (
        first | {"distance_m": -1.0},
        first | {"box_px": [1, 2, 3]},
        first | {"measured_by": "guess"},
        {name: value for name, value in first.items() if name != "contact"},
    ):
        assert not validator.is_valid(broken)


def test_an_unknown_speed_is_null() -> None:
    track = replace(car().track, speed_m_s=math.nan, sigma_speed_m_s=math.nan, contact=None)
    one = obstacle_fields(replace(car(), track=track), frame="1", time_s=0.0, number=1)
    assert one["speed_m_s"] is None
    json.dumps(one, allow_nan=False)


def test_the_table_has_velocity_and_contact_where_they_are_known() -> None:
    tracked, light, untracked = csv.DictReader(io.StringIO(encode_csv(fields()).decode()))
    assert float(tracked["velocity_z_m_s"]) == -8.25
    assert (float(tracked["contact_s"]), float(tracked["sigma_contact_s"])) == (2.4, 0.2)
    assert (tracked["track"], tracked["over_ground"]) == ("7", "True")
    assert float(light["sigma_along_m"]) == 0.21
    for row in (light, untracked):
        assert row["track"] == row["speed_m_s"] == row["contact_s"] == ""


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{", "no JSON"),
        ("[1]", "no object with a frame"),
        ('{"frame": "1"}', "rotation"),
        (json.dumps(fields()[0] | {"track_state": "lost"}), "track_state"),
        (json.dumps(fields()[0] | {"distance_m": -2}), "distance"),
    ],
)
def test_a_line_that_is_none_of_ours_is_named(tmp_path, line: str, message: str) -> None:
    path = tmp_path / "obstacles.jsonl"
    path.write_bytes(encode_jsonl(fields()) + line.encode() + b"\n")
    with pytest.raises(LabelError, match=message) as raised:
        read_obstacles(path)
    assert (raised.value.path, raised.value.where) == (str(path), "line 4")


def test_no_file_is_said_and_an_empty_one_has_none(tmp_path) -> None:
    with pytest.raises(LabelError):
        read_obstacles(tmp_path / "none.jsonl")
    (tmp_path / "empty.jsonl").write_bytes(b"")
    assert read_obstacles(tmp_path / "empty.jsonl") == {}


def test_the_schema_knows_every_way_of_measuring() -> None:
    ways = obstacle_schema()["properties"]["measured_by"]["enum"]
    assert set(ways) == set(get_args(MeasuredBy))
