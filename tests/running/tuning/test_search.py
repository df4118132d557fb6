"""The search on rendered pairs: repeatable, resumable, never worse than where it began."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from pseudolidar.errors import ImageMissing, OutputSettings, PseudolidarError, ReferenceMissing
from pseudolidar.running.tuning.judged import JudgedFrame, JudgedFrames, halves, mirrored
from pseudolidar.running.tuning.search import Budget, Search
from pseudolidar.running.tuning.space import Candidate, Space
from pseudolidar.running.tuning.trials import Trials, key_of
from pseudolidar.sources.selection import FrameSelection, select
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.map_filter import FilteredMatcher, MapFilters
from pseudolidar.structures.frame import PairMask

START = Candidate(Census(disparities=64))
SPACE = Space.around(START)


def load(candidate):
    filters = MapFilters.load(candidate.smooth, candidate.fill)
    return FilteredMatcher(candidate.matcher.load(), filters)


@pytest.fixture(scope="module")
def room():
    return Synthetic("room", frames=5, seed=2, width_px=160).open()


@pytest.fixture(scope="module")
def frames(room):
    return JudgedFrames.of(room, "auto", load(START), tuned_on=2, held=1)


def searched(frames, path, *, candidates, seed=0, workers=1, seconds=600.0, loader=load):
    kept = []
    trials = Trials.opened(path, {"seed": seed}, anew=False)
    search = Search(
        SPACE,
        frames,
        loader,
        trials,
        Budget(seconds),
        seed,
        workers,
        lambda scored, held: kept.append((scored, held)),
    )
    search.run(most_candidates=candidates)
    return search, kept


def test_truth_comes_first_and_frames_are_held_back(frames):
    assert frames.by == "truth"
    assert [part.id for part in frames.tuned_on] == ["000000", "000002"]
    assert [part.id for part in frames.held] == ["000004"]


@pytest.mark.parametrize("count", [1, 2, 3, 10, 100])
def test_held_frames_come_after_those_to_tune_on(count):
    first, last = halves(count, 6, 4)
    assert len(first) <= 6
    assert len(last) <= 4
    assert set(first) | set(last) <= set(range(count))
    if count > 1:
        assert max(first) < min(last)


def test_a_single_pair_is_judged_in_strips(room):
    one = select(room, FrameSelection.parse("2"))
    frames = JudgedFrames.of(one, "truth", load(START), tuned_on=6, held=4)
    (mine,), (theirs,) = frames.tuned_on, frames.held
    assert not (mine.rows & theirs.rows).any()
    assert (mine.rows | theirs.rows).all()
    assert (mine.id, theirs.id) == ("000002 even strips", "000002 odd strips")


def test_the_first_settings_come_first_and_better_ones_follow(frames, tmp_path):
    search, kept = searched(frames, tmp_path / "t.jsonl", candidates=40)
    assert (kept[0][0].candidate, kept[0][0].score, kept[0][1]) == (START, 1.0, 1.0)
    scores = [scored.score for scored, _ in kept]
    assert scores == sorted(scores, reverse=True)
    assert scores[-1] < 0.95
    assert all(held <= 1.0 for _, held in kept)
    best, held = kept[-1]
    assert held == search.score(best.candidate, frames.held)
    loss, usual = (
        np.array([each.loss for each in search.judgements(settings, frames.tuned_on)])
        for settings in (best.candidate, START)
    )
    assert best.score == pytest.approx(np.mean(loss / usual))
    # Rounds begin with different frames: none decides alone who goes on.
    seen = [search.judged_on(candidate) for candidate in search.tried.values()]
    assert {each[0].id for each in seen if len(each) == 1} == {"000000", "000002"}


def test_seed_decides_and_workers_do_not(frames, tmp_path):
    runs = [
        searched(frames, tmp_path / f"{name}.jsonl", candidates=30, seed=seed, workers=workers)
        for name, seed, workers in (("a", 3, 1), ("b", 3, 3), ("c", 4, 1))
    ]
    tried = [list(search.tried) for search, _ in runs]
    assert tried[0] == tried[1]
    assert tried[0] != tried[2]
    assert runs[0][1] == runs[1][1]


def test_a_search_goes_on_where_it_stopped(frames, tmp_path):
    whole, kept = searched(frames, tmp_path / "whole.jsonl", candidates=40)
    path = tmp_path / "parts.jsonl"
    searched(frames, path, candidates=17)
    before = path.read_bytes()
    path.write_bytes(before[:-40])  # a kill in the middle of a line
    judged = []

    def counting(candidate):
        judged.append(candidate)
        return load(candidate)

    again, kept_again = searched(frames, path, candidates=40, loader=counting)
    assert list(again.tried) == list(whole.tried)
    assert kept_again == kept
    assert len(judged) == len(whole.trials.known) - (before.count(b"\n") - 2)
    assert set(again.trials.known) == set(whole.trials.known)
    assert (whole.repeats_only, again.repeats_only) == (False, False)
    repeated, _ = searched(frames, path, candidates=40)
    assert repeated.repeats_only


def test_no_time_leaves_the_first_settings(frames, tmp_path):
    search, kept = searched(frames, tmp_path / "t.jsonl", candidates=None, seconds=1e-9)
    assert [scored.candidate for scored, _ in kept] == [START]
    assert set(search.trials.known) == {
        (key_of(START), part.id) for part in (*frames.tuned_on, *frames.held)
    }


def test_what_wins_by_chance_is_not_taken(frames, tmp_path):
    """Candidates that are better on the frames to tune on and worse on those held back."""
    held = frames.held[0]
    worse = dataclasses.replace(held, reference=held.reference + np.float32(2))

    class Biased:
        def __init__(self, candidate):
            self.matcher, self.first = load(candidate), candidate == START

        def __call__(self, frame):
            found = self.matcher(frame)
            if frame.id == held.frame.id and self.first:
                return type(found)(found.values + np.float32(2))
            return found

    against = dataclasses.replace(frames, held=(worse,))
    _, kept = searched(against, tmp_path / "t.jsonl", candidates=30, loader=Biased)
    assert [scored.candidate for scored, _ in kept] == [START]


def test_settings_that_cannot_be_matched_with_lose(frames, tmp_path):
    def failing(candidate):
        if candidate != START and candidate.matcher.quality == "fine":
            raise PseudolidarError("no", want="yes")
        return load(candidate)

    search, kept = searched(frames, tmp_path / "t.jsonl", candidates=30, loader=failing)
    assert kept[-1][0].candidate.matcher.quality == "fast"
    lost = [t for t in search.trials.known.values() if t.judgement.loss == np.inf]
    assert lost
    again = Trials.opened(tmp_path / "t.jsonl", {"seed": 0}, anew=False)
    assert again.known == search.trials.known


def test_where_the_first_settings_fail_the_reason_is_said(frames, tmp_path):
    def failing(candidate):
        raise PseudolidarError("no such thing", want="another")

    with pytest.raises(PseudolidarError, match="no such thing"):
        searched(frames, tmp_path / "t.jsonl", candidates=5, loader=failing)

    def failing_later(candidate):
        def match(frame):
            if frame.id == frames.held[0].frame.id:
                raise PseudolidarError("not this one", want="another")
            return load(candidate)(frame)

        return match

    with pytest.raises(PseudolidarError, match="not this one"):
        searched(frames, tmp_path / "u.jsonl", candidates=5, loader=failing_later)


def test_frames_that_can_be_read_are_shared_out(room):
    class WithoutTheFirst:
        ids, summary, rig = room.ids, room.summary, room.rig

        def load(self, index):
            if index < 3:
                raise ImageMissing("no file", want="a picture")
            return room.load(index)

    frames = JudgedFrames.of(WithoutTheFirst(), "truth", load(START), tuned_on=2, held=2)
    assert len(frames.skipped) == 2
    assert [part.id for part in frames.tuned_on] == ["000003"]
    assert [part.id for part in frames.held] == ["000004"]


def test_trials_of_another_search_are_refused(tmp_path):
    path = tmp_path / "t.jsonl"
    Trials.opened(path, {"seed": 1, "matcher": {"kind": "census"}}, anew=False)
    with pytest.raises(OutputSettings, match="seed = 1"):
        Trials.opened(path, {"seed": 2, "matcher": {"kind": "census"}}, anew=False)
    Trials.opened(path, {"seed": 2}, anew=True)
    assert json.loads(path.read_text())["search"] == {"seed": 2}
    path.write_text("notes of mine\n")
    with pytest.raises(OutputSettings, match="no journal"):
        Trials.opened(path, {"seed": 2}, anew=False)


def test_what_the_frames_do_not_have_is_refused(room):
    bare = JudgedFrames.of(room, "pairs", load(START), tuned_on=2, held=1)
    assert bare.tuned_on[0].reference is None
    assert bare.tuned_on[0].following is not None

    class WithoutTruth:
        ids, summary, rig = room.ids, room.summary, room.rig

        def load(self, index):
            return dataclasses.replace(room.load(index), truth=None, scan=None)

    with pytest.raises(ReferenceMissing):
        JudgedFrames.of(WithoutTruth(), "truth", load(START), tuned_on=2, held=1)
    assert JudgedFrames.of(WithoutTruth(), "auto", load(START), tuned_on=2, held=1).by == "pairs"
    by_scan = JudgedFrames.of(room, "scan", load(START), tuned_on=2, held=1)
    share = np.isfinite(by_scan.tuned_on[0].reference).mean()
    assert 0.02 < share < 0.9


def test_what_no_eye_saw_does_not_count(room):
    frame = room.load(1)
    left = np.ones(frame.left.shape[:2], bool)
    left[:, :60] = False
    masked = dataclasses.replace(frame, mask=PairMask(left, np.ones_like(left)))
    whole = JudgedFrame("a", frame, np.ones(len(left), bool), frame.truth.values)
    part = dataclasses.replace(whole, frame=masked)
    assert part(load(START)).density < whole(load(START)).density - 0.2
    other = mirrored(masked)
    np.testing.assert_array_equal(other.mask.right, left[:, ::-1])
    assert other.mask.left.all()
    np.testing.assert_array_equal(mirrored(other).right, frame.right)
