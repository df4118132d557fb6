"""Settings that are turned, taken back, kept and saved."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pseudolidar.pipelines.convert import Convert

from pseudolidar.commandline.execute import _values_of
from pseudolidar.commandline.verbs import load_verb
from pseudolidar.errors import PseudolidarError, UsageError
from pseudolidar.running.settings_json import tuned_file
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.neural import Onnx
from pseudolidar.stereo.reproject import Reproject
from pseudolidar.stereo.sgbm import Sgbm
from pseudolidar.viewer.tuning.bench import Bench

JOB = Convert(Synthetic("street"))


@pytest.fixture
def bench() -> Bench[Convert]:
    return Bench(JOB)


def turn(bench, name, value, now_s=0.0):
    part, _, setting = name.partition(".")
    part = bench.parts[part]
    knobs = {knob.name: knob for knob in part.knobs[bench.kind(part)]}
    return bench.turn(part, knobs[setting or part.name], value, now_s)


def test_knobs_change_the_job_and_nothing_else(bench):
    assert turn(bench, "matcher.uniqueness_percent", 20)
    assert turn(bench, "clean.sky", False)
    assert turn(bench, "rows", "never")
    expected = replace(
        JOB, matcher=Census(uniqueness_percent=20), clean=Clean(sky=False), rows="never"
    )
    assert bench.job == expected
    assert not turn(bench, "clean.sky", False)


def test_kinds_come_back_as_they_were_left(bench):
    matcher = bench.parts["matcher"]
    turn(bench, "matcher.quality", "fine")
    assert bench.choose(matcher, "sgbm", 1)
    assert bench.job.matcher == Sgbm()
    turn(bench, "matcher.block_size", 3)
    bench.choose(matcher, "census", 2)
    assert bench.job.matcher == Census(quality="fine")
    bench.choose(matcher, "sgbm", 3)
    assert bench.job.matcher == Sgbm(block_size=3)
    bench.choose(bench.parts["clean"], "none", 4)
    assert bench.job.clean is None
    assert not bench.choose(bench.parts["clean"], "none", 5)


def test_one_sweep_of_a_slider_is_one_step_back(bench):
    for step in range(20):
        turn(bench, "matcher.speckle_pixels", 10 * step, now_s=0.1 * step)
    turn(bench, "matcher.speckle_pixels", 500, now_s=60)
    assert bench.job.matcher.speckle_pixels == 500
    bench.undo()
    assert bench.job.matcher.speckle_pixels == 190
    bench.undo()
    assert bench.job == JOB
    bench.undo()
    assert bench.job == JOB


def test_so_many_steps_can_be_taken_back(bench, monkeypatch):
    monkeypatch.setattr("pseudolidar.viewer.tuning.bench.MOST_STEPS", 3)
    for step in range(1, 6):
        turn(bench, "matcher.speckle_pixels", 10 * step, now_s=60 * step)
    for _ in range(5):
        bench.undo()
    assert bench.job.matcher.speckle_pixels == 20


def test_what_cannot_be_is_refused_until_the_other_knob_is_turned_too(bench):
    bench.choose(bench.parts["matcher"], "sgbm", 0)
    with pytest.raises(PseudolidarError, match="p1"):
        turn(bench, "matcher.p1", 900)
    assert bench.job.matcher == Sgbm()
    turn(bench, "matcher.p2", 2000)
    assert bench.job.matcher == Sgbm(p1=900, p2=2000)


def test_what_was_refused_is_shown_as_long_as_it_is_tried_again(bench):
    matcher = bench.parts["matcher"]
    knobs = {knob.name: knob for knob in matcher.knobs["sgbm"]}
    bench.choose(matcher, "sgbm", 0)
    assert bench.value(matcher, knobs["p1"]) is None
    with pytest.raises(PseudolidarError, match="p1"):
        turn(bench, "matcher.p1", 900)
    turn(bench, "clean.sky", False)
    assert bench.value(matcher, knobs["p1"]) == 900
    turn(bench, "matcher.p1", None)
    assert bench.value(matcher, knobs["p1"]) is None
    with pytest.raises(PseudolidarError, match="p1"):
        turn(bench, "matcher.p1", 900)
    bench.undo()
    assert bench.value(matcher, knobs["p1"]) is None


def test_a_kind_of_the_start_that_needs_a_file_can_be_chosen_again():
    network = Onnx(Path("network.onnx"))
    bench = Bench(replace(JOB, matcher=network))
    bench.reset()
    assert bench.job.matcher == Census()
    assert bench.choose(bench.parts["matcher"], "onnx", 0)
    assert bench.job.matcher == network


def test_defaults_can_be_taken_back(bench):
    bench = Bench(replace(JOB, smooth=Fgs(), matcher=Sgbm()))
    bench.reset()
    assert bench.job == JOB
    bench.undo()
    assert bench.job.smooth == Fgs()


def test_kept_settings_stay_and_can_be_gone_back_to(bench):
    turn(bench, "matcher.penalty_large", 80)
    bench.keep()
    turn(bench, "matcher.penalty_large", 70, now_s=10)
    assert (bench.kept.matcher.penalty_large, bench.job.matcher.penalty_large) == (80, 70)
    bench.restore()
    assert bench.job == bench.kept


def test_every_verb_reads_what_was_saved(bench, tmp_path):
    turn(bench, "matcher.agreement_px", 0.5)
    bench.choose(bench.parts["smooth"], "fgs", 5)
    turn(bench, "reproject.max_range_m", 40)
    file = tmp_path / "settings.json"
    file.write_bytes(tuned_file(bench.as_json(), {"by": "view"}))
    # `clean` is at its default, so that verbs with another keep theirs.
    assert set(json.loads(file.read_bytes())["settings"]) == {"matcher", "smooth", "reproject"}
    values = _values_of(load_verb("convert"), file)
    assert values == {
        "matcher": Census(agreement_px=0.5), "smooth": Fgs(), "reproject": Reproject(max_range_m=40)
    }  # fmt: skip
    assert _values_of(load_verb("view"), file) == values
    for verb in ("map", "obstacles", "measure", "tune", "compare"):
        assert _values_of(load_verb(verb), file)["matcher"] == Census(agreement_px=0.5)
    file.write_bytes(tuned_file({"sky": 1}, {}))
    with pytest.raises(UsageError, match="unknown part"):
        _values_of(load_verb("convert"), file)
