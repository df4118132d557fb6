"""The rig file: how good a calibration is, lenses of every kind, rigs of unknown scale."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationUnits,
    CalibrationValue,
    PseudolidarError,
)
from pseudolidar.formats.rigs.rig_fields import MINIMAL_RIG
from pseudolidar.formats.rigs.rig_json import (
    parse_rig,
    rig_notes,
    rig_schema,
    rig_text,
)
from pseudolidar.structures.quality import CalibrationQuality, CameraSigma
from tests.formats.rigs.test_rig_json import assert_same, changed, full_rig


def known_quality() -> CalibrationQuality:
    """All that a calibration can tell, in numbers that need all their digits."""
    rng = np.random.default_rng(9)
    return CalibrationQuality(
        rms_left_px=0.1 + 0.2,
        rms_right_px=1 / 3,
        rms_stereo_px=0.25,
        holdout_row_error_px=1 / 7,
        views=29,
        left=CameraSigma(rng.uniform(size=4), rng.uniform(size=5)),
        right=CameraSigma(rng.uniform(size=4)),
        rotation_sigma_rad=rng.uniform(size=3) / 1e3,
        translation_sigma_m=rng.uniform(size=3) / 1e3,
        baseline_sigma_m=1e-4 / 3,
        depth_sigma_m=np.array([[1.0, 0.01 / 3], [10.0, 0.3]]),
        nearest_m=0.7 / 3,
    )


def assert_same_quality(a: CalibrationQuality | None, b: CalibrationQuality | None) -> None:
    assert a is not None
    assert b is not None
    for name in ("rms_left_px", "rms_right_px", "rms_stereo_px", "holdout_row_error_px", "views",
                 "baseline_sigma_m", "nearest_m"):  # fmt: skip
        assert getattr(a, name) == getattr(b, name), name
    for name in ("rotation_sigma_rad", "translation_sigma_m", "depth_sigma_m"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for mine, theirs in ((a.left, b.left), (a.right, b.right)):
        assert mine is not None
        assert theirs is not None
        np.testing.assert_array_equal(mine.intrinsics_px, theirs.intrinsics_px)
        np.testing.assert_array_equal(mine.distortion, theirs.distortion)


def test_pictures_of_another_size_have_other_pixels() -> None:
    """Twice as wide and three times as high: x by 2, y by 3, rows by 3, the rest stays."""
    quality = known_quality()
    other = quality.scaled(2.0, 3.0)
    for mine, theirs in ((other.left, quality.left), (other.right, quality.right)):
        np.testing.assert_allclose(mine.intrinsics_px, theirs.intrinsics_px * [2, 3, 2, 3])
        np.testing.assert_array_equal(mine.distortion, theirs.distortion)
    assert other.holdout_row_error_px == pytest.approx(3 * quality.holdout_row_error_px)
    for name in ("rms_left_px", "rms_right_px", "rms_stereo_px"):
        assert getattr(other, name) == pytest.approx(np.sqrt(6) * getattr(quality, name))
    for name in ("rotation_sigma_rad", "translation_sigma_m", "baseline_sigma_m", "depth_sigma_m"):
        np.testing.assert_array_equal(getattr(other, name), getattr(quality, name))
    assert (other.views, other.nearest_m) == (quality.views, quality.nearest_m)


LENSES = [("pinhole", n) for n in (0, 4, 5, 8, 12, 14)] + [("fisheye", 4)]


@pytest.mark.parametrize(("model", "coefficients"), LENSES)
def test_every_lens_and_eyes_of_two_sizes_stay_with_their_quality(
    model: str, coefficients: int
) -> None:
    lens = np.random.default_rng(coefficients).normal(size=coefficients) / 7
    rig = full_rig(rectified=False)
    left = replace(rig.left, distortion=lens, model=model)
    right = replace(left, K=rig.right.K / 2 + np.diag([0, 0, 0.5]), width_px=640, height_px=200,
                    distortion=lens / 3, frame="camera_right")  # fmt: skip
    quality = known_quality()
    rig = replace(rig, left=left, right=right, quality=quality)
    document = rig_text(rig)
    read = parse_rig(document, "rig.json")
    assert_same(read, rig)
    assert_same_quality(read.quality, quality)
    assert rig_text(read) == document
    assert any("stereo rms 0.25 px" in note and "29 views" in note for note in rig_notes(read))
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator(rig_schema()).validate(json.loads(document))


def test_the_quality_of_a_resized_rig() -> None:
    quality = known_quality()
    left = replace(full_rig(rectified=False).left, width_px=1280, height_px=400)
    rig = replace(
        full_rig(rectified=False),
        left=left,
        right=replace(left, K=left.K / 2 + np.diag([0, 0, 0.5]), width_px=640, height_px=200,
                      frame="camera_right"),
        quality=quality,
    )  # fmt: skip
    half = rig.scaled_to(640, 200)
    assert half.right.size_px == (320, 100)
    np.testing.assert_allclose(half.right.K[:2, :2], rig.right.K[:2, :2] / 2)
    assert half.quality is not None
    assert half.quality.left is not None
    assert half.quality.rms_stereo_px == pytest.approx(0.125)
    np.testing.assert_allclose(
        half.quality.left.intrinsics_px * 2, known_quality().left.intrinsics_px
    )
    np.testing.assert_array_equal(half.quality.left.distortion, quality.left.distortion)
    np.testing.assert_array_equal(half.quality.depth_sigma_m, quality.depth_sigma_m)


@pytest.mark.parametrize(
    ("fields", "kind", "where", "got"),
    [
        ({"rms_left_px": -1}, CalibrationValue, "quality.rms_left_px", "-1"),
        ({"rms_left": 1}, CalibrationField, "quality.rms_left", "unknown"),
        ({"views": 0.5}, CalibrationSyntax, "quality.views", "0.5"),
        ({"rotation_sigma_rad": [1, 2]}, CalibrationSyntax, "rotation_sigma_rad", "2 values"),
        ({"translation_sigma_m": [1, -2, 0]}, CalibrationValue, "translation_sigma_m", "-2"),
        ({"left_sigma": {"fx": 1}}, CalibrationField, "quality.left_sigma", "'fy'"),
        (
            {"left_sigma": {"fx": 1, "fy": -1, "cx": 1, "cy": 1}},
            CalibrationValue,
            "left_sigma",
            "-1",
        ),
        ({"depth_sigma_m": [[9, 1], [5, 1]]}, CalibrationValue, "depth_sigma_m", "9.0, 5.0"),
        ({"depth_sigma_m": [[9, 1, 3]]}, CalibrationSyntax, "depth_sigma_m[0]", "3 values"),
        ({"depth_sigma_m": []}, CalibrationSyntax, "depth_sigma_m", "list of 0"),
    ],
)
def test_mistakes_in_the_quality_are_named(
    fields: dict[str, object], kind: type[PseudolidarError], where: str, got: str
) -> None:
    with pytest.raises(kind) as caught:
        parse_rig(changed(quality=fields), "rig.json")
    assert where in caught.value.where
    assert got in caught.value.got


def test_a_rig_of_unknown_scale_says_so_everywhere(tmp_path: Path) -> None:
    """Lengths that are no metres: in the file, the notes, the line for people; metres refused."""
    unknown = replace(parse_rig(MINIMAL_RIG, "rig.json"), metric=False)
    text = rig_text(unknown)
    assert json.loads(text)["metric"] is False
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.validate(json.loads(text), rig_schema())
    back = parse_rig(text, tmp_path / "rig.json")
    assert not back.metric
    assert any("scale unknown" in note for note in rig_notes(back))
    assert "m" not in back.baseline_text.split()
    with pytest.raises(CalibrationUnits, match="unknown scale") as error:
        back.check_metric()
    assert "--known-distance" in error.value.fix
    known = replace(back, metric=True)
    assert "metric" not in json.loads(rig_text(known))
    known.check_metric()
    with pytest.raises(CalibrationSyntax, match="true or false"):
        parse_rig(text.replace("false", "0"), "rig.json")
