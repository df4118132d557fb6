"""Rig files of several pairs: exact round trip, one pair by its name, mistakes by their place."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationValue,
    PseudolidarError,
)
from pseudolidar.formats.rigs.body_json import (
    body_text,
    has_pairs,
    parse_body,
    read_body,
    write_body,
)
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import rig_schema
from pseudolidar.structures.body import BodyRig, MountedPair
from pseudolidar.structures.pose import Pose
from tests.body_rigs import body_rig
from tests.formats.rigs.test_rig_json import assert_same, full_rig, rotation
from tests.formats.rigs.test_rig_quality import assert_same_quality, known_quality


def full_body() -> BodyRig:
    """Pairs with all that a pair can have: a rectified one and one that is not."""
    rng = np.random.default_rng(2)
    pairs = []
    for number, (name, rectified) in enumerate((("front", True), ("rear-2", False))):
        place = Pose.from_rotation(
            "base_link", "camera_left", rotation(number + 5), rng.normal(size=3)
        )
        rig = replace(full_rig(rectified=rectified), quality=known_quality(), metric=rectified)
        turn, shift = rng.uniform(size=3) / 1000, rng.uniform(size=3) / 100
        sigmas = (None, None) if rectified else (turn, shift)
        pairs.append(MountedPair(name, rig, place, *sigmas))
    return BodyRig(tuple(pairs), "größer \n\udcff")


def test_round_trip_is_exact(tmp_path: Path) -> None:
    body, path = full_body(), tmp_path / "rig.json"
    write_body(path, body)
    read = read_body(path)
    assert read.names == ("front", "rear-2")
    assert read.origin == body.origin
    for got, want in zip(read.pairs, body.pairs, strict=True):
        assert_same(got.rig, want.rig)
        assert_same_quality(got.rig.quality, want.rig.quality)
        np.testing.assert_array_equal(got.T_base_link_left.matrix, want.T_base_link_left.matrix)
        for name in ("rotation_sigma_rad", "translation_sigma_m"):
            np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
    assert body_text(read) == path.read_text()
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(rig_schema())
    validator.validate(json.loads(path.read_text()))
    for wrong in ({"schema": 1}, {"schema": 1, "pairs": {}}, {"schema": 1, "pairs": {"a": {}}}):
        assert not validator.is_valid(wrong)
    both = json.loads(path.read_text()) | {"left": {"fx": 1, "cx": 1, "cy": 1}}
    assert not validator.is_valid(both)


def test_standard_deviations_of_a_place_are_called_what_they_are() -> None:
    body = full_body()
    written = json.loads(body_text(body))["pairs"]
    assert "T_base_link_left_sigma" not in written["front"]
    rear = body["rear-2"]
    assert written["rear-2"]["T_base_link_left_sigma"] == {
        "rotation_rad": rear.rotation_sigma_rad.tolist(),
        "t_m": rear.translation_sigma_m.tolist(),
    }
    for name, pair in written.items():
        quality = body[name].rig.quality
        for eye in ("left", "right"):
            fx_px = getattr(quality, eye).intrinsics_px[0]
            assert pair["quality"][f"{eye}_sigma"]["fx"] == fx_px


def test_one_pair_by_its_name(tmp_path: Path) -> None:
    body, path = full_body(), tmp_path / "rig.json"
    write_body(path, body)
    assert has_pairs(path)
    assert not has_pairs(tmp_path / "absent.json")
    assert_same(read_any_rig(f"{path}#front").of_rectified, body["front"].rig)
    rear = read_any_rig(f"{path}#rear-2").raw
    assert rear is not None
    assert_same(rear, body["rear-2"].rig)
    with pytest.raises(CalibrationField, match=r"2 pairs: front, rear-2") as error:
        read_any_rig(path)
    assert f"{path}#front" in error.value.fix
    with pytest.raises(CalibrationField, match="no pair 'left'; found front, rear-2"):
        read_any_rig(f"{path}#left")
    with pytest.raises(CalibrationMissing):
        read_any_rig(f"{tmp_path / 'absent.json'}#front")


GOOD = json.loads(body_text(body_rig()))


def changed(**fields: object) -> str:
    """The body of three pairs with other fields of the pair front; None takes one out."""
    front = GOOD["pairs"]["front"] | fields
    front = {key: value for key, value in front.items() if value is not None}
    return json.dumps(GOOD | {"pairs": GOOD["pairs"] | {"front": front}}, indent=1)


@pytest.mark.parametrize(
    ("document", "kind", "where", "got"),
    [
        (changed(T_base_link_left=None), CalibrationField, "pairs.front", "no 'T_base_link_left'"),
        (changed(T_base_left=1), CalibrationField, "pairs.front.T_base_left", "unknown key"),
        (changed(width_px=0), CalibrationSyntax, "pairs.front.width_px", "0"),
        (changed(left={"fx": -1, "cx": 1, "cy": 1}), CalibrationValue, "pairs.front.left", "-1"),
        (
            changed(T_base_link_left={"R": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], "t_m": [0, 0, 0]}),
            CalibrationValue,
            "pairs.front.T_base_link_left.R",
            "no rotation",
        ),
        (
            changed(T_base_link_left_sigma={"t_m": [1, 2, 3]}),
            CalibrationField,
            "T_base_link_left_sigma",
            "rotation_rad",
        ),
        (json.dumps({"schema": 2, "pairs": {}}), CalibrationValue, "schema", "schema 2"),
        (json.dumps({"schema": 1, "pairs": {}}), CalibrationValue, "pairs", "pairs none"),
        (json.dumps({"schema": 1, "pairs": [1]}), CalibrationSyntax, "pairs", "a list of 1"),
        (json.dumps({"schema": 1, "pairs": {"a": 1}}), CalibrationSyntax, "pairs.a", "1"),
        (json.dumps(GOOD | {"left": 1}), CalibrationField, "left", "unknown key 'left'"),
        (
            json.dumps(GOOD | {"pairs": {"../up": GOOD["pairs"]["front"]}}),
            CalibrationValue,
            "pairs",
            "'../up'",
        ),
        (
            json.dumps(GOOD | {"pairs": {"a": GOOD["pairs"]["left"], "A": GOOD["pairs"]["right"]}}),
            CalibrationValue,
            "pairs",
            "pairs a, A",
        ),
    ],
)
def test_mistakes_are_named_by_pair_and_line(
    document: str, kind: type[PseudolidarError], where: str, got: str
) -> None:
    with pytest.raises(kind) as error:
        parse_body(document, "rig.json")
    assert where in error.value.where
    assert got in error.value.got
    assert error.value.path == "rig.json"
