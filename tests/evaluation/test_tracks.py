"""Scores of tracks whose mistakes are known."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.evaluation.tracks import ToldTrack, TrackJudge, TrueObject, pooled
from pseudolidar.structures.box import Box3D
from pseudolidar.structures.pose import Pose


def box(x: float) -> Box3D:
    return Box3D(
        Pose.from_rotation("camera_left", "box", np.eye(3), np.array([x, 0.0, 20.0])), 4, 2, 1.5
    )


def true(number: int, x: float, *, seen: bool = True) -> TrueObject:
    return TrueObject(number, box(x), np.array([1.0, 0.0, 0.0]), seen)


def told(number: int, x: float, *, coasting: bool = False) -> ToldTrack:
    return ToldTrack(number, box(x), np.array([1.3, 0.0, 0.4]), np.full(3, 0.35), coasting)


def judged(*frames):
    judge = TrackJudge()
    for truth, tracks in frames:
        judge.add(truth, tracks)
    return judge.score()


def test_all_right() -> None:
    score = judged(*[([true(1, 0), true(2, 8)], [told(5, 0.3), told(6, 8)])] * 3)
    assert (score.objects, score.missed, score.wrong, score.switches) == (6, 0, 0, 0)
    assert score.mota == 1.0
    assert np.median(score.speed_errors_m_s) == pytest.approx(0.5)
    assert score.within_1_sigma == pytest.approx(0.5)  # 0.3 is within 0.35, 0.4 is not
    assert score.within_2_sigma == 1.0
    assert score.normalised_squared == pytest.approx((0.3**2 + 0.4**2) / 2 / 0.35**2)


def test_two_that_change_places_are_two_switches() -> None:
    score = judged(
        ([true(1, 0), true(2, 8)], [told(5, 0), told(6, 8)]),
        ([true(1, 0), true(2, 8)], [told(6, 0), told(5, 8)]),
    )
    assert (score.switches, score.missed, score.wrong) == (2, 0, 0)
    assert score.mota == pytest.approx(0.5)


def test_a_near_one_does_not_take_the_track_of_the_last_frame() -> None:
    score = judged(
        ([true(1, 0)], [told(5, 0.0)]),
        ([true(1, 0)], [told(5, 1.5), told(6, 0.1)]),
    )
    assert (score.switches, score.wrong) == (0, 1)


def test_gaps_and_tracks_of_nothing() -> None:
    score = judged(
        ([true(1, 0)], [told(5, 0)]),
        ([true(1, 0)], [told(7, 9)]),
        ([true(1, 0)], [told(5, 0)]),
        ([true(1, 0)], [told(5, 0)]),
    )
    assert (score.missed, score.wrong, score.fragments, score.switches) == (1, 1, 1, 0)
    assert score.mota == pytest.approx(0.5)
    assert score.identities == 2


def test_what_is_hidden_is_nobodys_duty() -> None:
    score = judged(
        ([true(1, 0)], [told(5, 0)]),
        ([true(1, 0, seen=False)], []),
        ([true(1, 0, seen=False)], [told(5, 1.0, coasting=True)]),
        ([], [told(5, 9.0, coasting=True)]),
        ([true(1, 0)], [told(5, 0)]),
    )
    assert (score.objects, score.missed, score.wrong, score.switches) == (2, 0, 0, 0)
    assert score.coasting_off_m.tolist() == [1.0]
    assert len(score.place_off_m) == 2
    assert pooled([score, score]).objects == 4


def test_nothing_at_all() -> None:
    score = judged(([], []))
    assert score.as_dict()["mota"] is None
    assert score.as_dict()["velocity_median_abs_m_s"] is None
