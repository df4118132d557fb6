"""Every setting of matchers and filters can be turned, within a range that holds its default."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pseudolidar.pipelines.convert import Convert

from pseudolidar.running.settings_schema import choice_name, settings_fields
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.viewer.tuning.knobs import NOT_TUNED, knobs_of, parts_of

JOB = Convert(Synthetic("street"))
PARTS = {part.name: part for part in parts_of(JOB)}
KINDS = [kind for part in PARTS.values() for kind in part.kinds.values() if kind is not None]


@pytest.mark.parametrize("kind", KINDS, ids=choice_name)
def test_every_setting_has_a_knob_or_is_none_of_the_picture(kind):
    turned = {f"{choice_name(kind)}.{knob.name}" for knob in knobs_of(kind)}
    every = {f"{choice_name(kind)}.{field.name}" for field in settings_fields(kind)}
    assert turned == every - NOT_TUNED


@pytest.mark.parametrize("kind", KINDS, ids=choice_name)
def test_ranges_hold_defaults_and_every_knob_says_what_it_does(kind):
    for knob in knobs_of(kind):
        assert knob.hint, knob.name
        if knob.span is None:
            continue
        default = getattr(kind(), knob.name)
        at = knob.span.start if default is None else default
        assert at is not None, knob.name
        assert knob.span.low <= at <= knob.span.high, knob.name


def test_parts_are_those_of_the_job_with_its_words():
    assert list(PARTS) == [
        "matcher", "rows", "balance", "clean", "temporal", "smooth", "fill", "reproject",
        "outliers",
    ]  # fmt: skip
    assert list(PARTS["matcher"].kinds) == ["census", "sgbm", "bm"]
    assert list(PARTS["smooth"].kinds) == ["fgs", "none"]
    assert PARTS["rows"].plain
    assert PARTS["rows"].knobs[""][0].options == ("auto", "never")


def test_a_network_is_offered_where_one_was_given():
    job = replace(JOB, matcher=Onnx(Path("net.onnx")))
    (matcher, *_) = parts_of(job)
    assert "onnx" in matcher.kinds
    names = {knob.name for knob in matcher.knobs["onnx"]}
    assert {"consistency", "iterations", "max_disparity"} <= names
    assert not {"path", "provider", "threads", "sha256"} & names


def test_a_range_grows_to_what_was_asked_for():
    (knob,) = [one for one in knobs_of(Census, Census(speckle_pixels=5000)) if "pixels" in one.name]
    assert knob.span is not None
    assert knob.span.high == 5000


def test_values_of_controls_become_those_of_settings():
    knobs = {knob.name: knob for knob in knobs_of(Census)}
    assert knobs["speckle_pixels"].taken(200.0) == 200
    assert isinstance(knobs["speckle_pixels"].taken(200.0), int)
    assert knobs["uniqueness_percent"].taken(0.1 + 0.2) == 0.3
    assert knobs["penalty_small"].taken(None) is None
    assert knobs["agreement_px"].label == "agreement, px"
    limits = {knob.name: knob for knob in knobs_of(Reproject)}
    assert limits["max_sigma_m"].optional
