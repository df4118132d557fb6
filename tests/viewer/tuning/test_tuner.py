"""Settings tried on the frame of a real view: a first look, then in full; figures and pictures."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert, ConvertFrame, opened

from pseudolidar.errors import StereoConfig
from pseudolidar.evaluation.disparity import disparity_errors
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.sgbm import Bm
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.viewer import latest as latest_module
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.moment import STEREO
from pseudolidar.viewer.reel import SourceReel
from pseudolidar.viewer.tuning.figures import Reference, figures_of, range_table_of, table_of
from pseudolidar.viewer.tuning.judge import GAINED, LOST, compared_picture, difference_picture
from pseudolidar.viewer.tuning.reduced import (
    enlarged,
    parts_of_width,
    reduced,
    reduced_settings,
)
from pseudolidar.viewer.tuning.side_by_side import KEPT_CLOUD, side_by_side
from pseudolidar.viewer.tuning.tuner import Tuner, Wanted, Workshop, reduced_job
from pseudolidar.viewer.view import View
from tests.viewer.clients import wait_until

JOB = Convert(Synthetic("street", frames=2, width_px=400))
SPARSE = replace(JOB, matcher=Census(uniqueness_percent=25))


@pytest.fixture(autouse=True)
def small_is_wide(monkeypatch):
    """So that a quick little picture has a first look too."""
    monkeypatch.setattr("pseudolidar.viewer.tuning.reduced.WIDE_PX", 200)


@pytest.fixture(scope="module")
def source():
    return opened(JOB)


@pytest.fixture(scope="module")
def frame(source):
    return source.load(0)


@pytest.fixture(scope="module")
def converted(source, frame):
    return {job: ConvertFrame.of(job, source).converted(frame) for job in (JOB, SPARSE)}


@pytest.fixture
def tuned(server, source) -> Iterator[tuple[View, Tuner[Convert], list]]:
    loads = lambda job: ConvertFrame.of(job, source).converted  # noqa: E731
    reel, told = SourceReel(source, loads(JOB)), []
    view = View(server, reel)
    yield view, Tuner(view, reel, Workshop(JOB, loads), told.append), told
    view.stop()


def drawn(view, until):
    for _ in range(400):
        view.tick(0.0)
        if view.moment is not None and until(view.moment):
            return view.moment
        threading.Event().wait(0.02)
    raise AssertionError("never shown")


def test_settings_are_shown_small_first_then_whole_then_in_other_frames(tuned, converted):
    view, tuner, told = tuned
    drawn(view, lambda moment: moment.converted is not None)
    tuner.ask(Wanted(SPARSE))
    assert tuner.idle(30)
    assert [one.matched_at for one in told] == [0.5, 1.0]
    shown = drawn(view, lambda moment: moment.matched_at == 1).converted
    expected = converted[SPARSE].disparity.values
    assert np.array_equal(shown.disparity.values, expected, equal_nan=True)
    view.jump(1)
    other = drawn(view, lambda moment: moment.index == 1).converted
    assert np.array_equal(
        other.disparity.values,
        ConvertFrame.of(SPARSE, view.reel.source.source)
        .converted(view.reel.source.source.load(1))
        .disparity.values,
        equal_nan=True,
    )


def test_kept_settings_are_shown_beside(tuned):
    view, tuner, told = tuned
    drawn(view, lambda moment: moment.converted is not None)
    tuner.ask(Wanted(SPARSE, kept=JOB, shown="both"))
    assert tuner.idle(30)
    moment = drawn(view, lambda moment: KEPT_CLOUD in moment.clouds)
    kept, now = moment.compared
    assert len(moment.clouds[KEPT_CLOUD]) > len(moment.clouds[STEREO])
    assert kept.disparity.valid.sum() > now.disparity.valid.sum()
    told.clear()
    tuner.ask(Wanted(SPARSE, kept=JOB, shown="A"))
    assert tuner.idle(30)
    assert [one.matched_at for one in told] == [1.0]  # both are known
    assert drawn(view, lambda moment: moment.converted is kept).matched_at == 1


def test_settings_that_are_in_use_stay_loaded(tuned, monkeypatch):
    view, tuner, _ = tuned
    drawn(view, lambda moment: moment.converted is not None)
    loads, looks, present = [], [], view.present
    load = tuner._workshop.load
    tuner._workshop = Workshop(JOB, lambda job: loads.append(job) or load(job))

    def presented(trial, moment, *, last):
        looks.append((moment.matched_at, moment.compared))
        present(trial, moment, last=last)

    monkeypatch.setattr(view, "present", presented)
    for percent in (21, 22, 23):
        job = replace(JOB, matcher=Census(uniqueness_percent=percent))
        tuner.ask(Wanted(job, kept=JOB))
        assert tuner.idle(30)
    assert loads.count(JOB) == 1
    # The kept ones are not matched for a first look, and stand beside it where they are known.
    assert [matched_at for matched_at, _ in looks] == 3 * [0.5, 1.0]
    assert looks[0][1] is None
    assert all(compared[0] is looks[1][1][0] for _, compared in looks[1:])
    looks.clear()
    tuner.ask(Wanted(replace(JOB, matcher=Census(uniqueness_percent=20)), kept=JOB, shown="A"))
    assert tuner.idle(30)
    assert [matched_at for matched_at, _ in looks] == [1.0]  # nothing new is to be seen


def test_what_measures_is_loaded_once():
    loads = []

    def sighted(job):
        loads.append(job)
        return lambda frame: (job, frame)

    measuring = Workshop("job", None, sighted).measuring("other")
    assert loads == []
    assert [measuring(frame) for frame in (1, 2)] == [("other", 1), ("other", 2)]
    assert loads == ["other"]
    assert Workshop("job", None).measuring("other") is None


def test_what_cannot_be_loaded_is_told_and_changes_nothing(tuned):
    view, tuner, told = tuned
    before = view.reel

    def load(_job):
        raise StereoConfig("never", want="something else")

    tuner._workshop = Workshop(JOB, load)
    tuner.ask(Wanted(SPARSE))
    assert tuner.idle(30)
    assert "never" in told[0].refused
    assert view.reel is before


def test_a_frame_that_cannot_be_matched_says_why(tuned):
    view, tuner, _ = tuned
    drawn(view, lambda moment: moment.converted is not None)
    tuner.ask(Wanted(replace(JOB, matcher=Census(disparities=1024))))
    assert tuner.idle(30)
    assert "1024" in drawn(view, lambda moment: bool(moment.fault)).fault
    tuner.ask(Wanted(JOB))
    assert tuner.idle(30)
    drawn(view, lambda moment: not moment.fault)


def test_only_the_latest_is_done():
    begun, go, done = threading.Event(), threading.Event(), []

    def work(request, overtaken):
        begun.set()
        go.wait(60)
        done.append((request, overtaken()))

    latest = Latest(work)
    latest.ask(0)
    assert begun.wait(60)
    for request in (1, 2, 3):
        latest.ask(request)
    assert not latest.idle(0.01)
    go.set()
    assert latest.idle(10)
    latest.close()
    latest.ask(4)
    assert done == [(0, True), (3, False)]


def test_work_rests_while_others_need_the_processor(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(latest_module, "RESTS", 1e9)
    monkeypatch.setattr(latest_module, "LONGEST_REST_S", 60.0)
    done, playing = list[int](), threading.Event()
    playing.set()
    latest = Latest[int](lambda request, _overtaken: done.append(request), makes_way=playing.is_set)
    latest.ask(1)
    wait_until(lambda: done == [1])
    for request in (2, 3):
        latest.ask(request)
    assert not latest.idle(0.1)
    assert done == [1]
    playing.clear()
    latest.ask(4)
    assert latest.idle(5)
    assert done == [1, 4]
    playing.set()
    latest.ask(5)
    wait_until(lambda: done == [1, 4, 5])
    latest.close()  # waits for no rest


def test_a_reduced_pair_has_the_depths_of_the_whole_one(frame, source, converted):
    small = ConvertFrame.of(reduced_job(JOB, 2), source).converted(reduced(frame, 2))
    large = enlarged(small, frame)
    whole = converted[JOB]
    assert large.disparity.values.shape == whole.disparity.values.shape
    both = large.disparity.valid & whole.disparity.valid
    off = np.abs(large.depth.values[both] / whole.depth.values[both] - 1)
    assert np.median(off) < 0.02
    assert large.cloud.uv.max() < 400
    column, row = np.rint(large.cloud.uv).astype(int).T
    assert np.isfinite(large.depth.values[row, column]).mean() > 0.99


def test_pictures_are_halved_until_they_are_small(monkeypatch):
    monkeypatch.setattr("pseudolidar.viewer.tuning.reduced.WIDE_PX", 640)
    assert [parts_of_width(width) for width in (512, 640, 1242, 1281, 4096)] == [1, 1, 2, 4, 8]


def test_settings_in_pixels_shrink_with_the_picture():
    census = reduced_settings(Census(disparities=160, speckle_pixels=200, agreement_px=1.5), 2)
    assert census == Census(disparities=64, speckle_pixels=50, agreement_px=1.5)
    assert reduced_settings(Census(), 2).disparities is None
    assert reduced_settings(Bm(speckle_pixels=1), 4).speckle_pixels == 1
    assert reduced_settings(Surfaces(largest_px=40), 4).largest_px == 10
    assert reduced_settings(None, 2) is None


def test_figures_are_those_of_the_library(frame, converted):
    reference = Reference.of(frame)
    figures = figures_of(converted[JOB], reference)
    errors = disparity_errors(converted[JOB].disparity, frame.truth)
    assert (figures.by, figures.d1) == ("ground truth", errors.d1_est)
    assert figures.density == converted[JOB].disparity.valid.mean()
    assert figures.depth_rel < 0.02
    by_scan = Reference.of(replace(frame, truth=None))
    assert by_scan.by == "LiDAR"
    assert figures_of(converted[JOB], by_scan).depth_rel < 0.02
    assert Reference.of(replace(frame, truth=None, scan=None)) is None


@pytest.mark.parametrize("gone", ["truth", "scan"])
def test_depths_are_by_the_rig_with_its_correction(frame, converted, gone):
    too_large = np.zeros(DisparityCorrection.TERMS)
    too_large[0] = 1.0  # px
    off = frame.rig.with_correction(DisparityCorrection(too_large, 0.0))
    figures = [
        figures_of(replace(converted[JOB], frame=one), Reference.of(one))
        for one in (replace(frame, rig=rig, **{gone: None}) for rig in (frame.rig, off))
    ]
    for right, wrong in zip(*(one.ranges[1:3] for one in figures), strict=True):
        depth_m = 0.5 * (right.from_m + right.to_m)
        expected = depth_m / (frame.rig.left.focal_px * frame.rig.baseline_m)  # of 1 px
        assert abs(right.bias_rel) < 0.02
        assert wrong.bias_rel == pytest.approx(expected, rel=0.4)  # depths of the bin differ


def test_tables_tell_both_and_their_change(frame, converted):
    rows = [
        (name, figures_of(converted[job], Reference.of(frame)))
        for name, job in (("A", JOB), ("B", SPARSE))
    ]
    lines = table_of(rows).splitlines()
    assert lines[0] == "|  | density | D1 | D1 filled | depth off | points |"
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| A", "| B", "| change"]
    assert "-" in lines[-1].split(" | ")[1]  # sparser
    assert "10-20 m" in range_table_of(rows)
    alone = table_of([("now", figures_of(converted[JOB], None))])
    assert "D1" not in alone
    assert range_table_of([("now", figures_of(converted[JOB], None))]) == ""


def test_differences_are_seen(converted):
    kept = np.array([[10, 10, np.nan, 10]], np.float32)
    now = np.array([[10, 13, 10, np.nan]], np.float32)
    same, off, gained, lost = difference_picture(kept, now)[0]
    assert tuple(gained) == GAINED
    assert tuple(lost) == LOST
    assert same[2] > same[0]
    assert off[0] > off[2]
    assert compared_picture(converted[JOB], converted[SPARSE]).shape[1] == 480
    assert side_by_side(converted[JOB], None, "both").compared is None
