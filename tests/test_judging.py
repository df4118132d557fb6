"""Benchmarks end with 1 where a figure is not as wanted, and name it."""

from __future__ import annotations

import math

import pytest

from tests.benchmarks.block import judged
from tests.benchmarks.judging import Figure, end


def test_a_figure_holds_up_to_its_bound():
    assert Figure("06: end", 0.008, 0.008).holds
    assert not Figure("06: end", 0.0081, 0.008).holds
    assert Figure("yaw: caught", 0.9, 0.9, least=True).holds
    assert not Figure("yaw: caught", 0.89, 0.9, least=True).holds
    assert not Figure("06: end", math.nan, 0.008).holds
    assert not Figure("yaw: caught", math.nan, 0.9, least=True).holds


def test_what_does_not_hold_is_named(capsys: pytest.CaptureFixture[str]):
    good = Figure("06 vision: t_rel", 0.006, 0.007)
    with pytest.raises(SystemExit) as ended:
        end([good])
    assert (ended.value.code, capsys.readouterr().out) == (0, "1 of 1 figures hold\n")
    with pytest.raises(SystemExit) as ended:
        end([good, Figure("06 vision: error at the end", 0.0084, 0.008)])
    named = "NOT HELD  06 vision: error at the end: 0.84%, at most 0.80% wanted\n"
    assert (ended.value.code, capsys.readouterr().out) == (1, named + "1 of 2 figures hold\n")


def test_a_block_must_drift_without_loops_and_be_closed_with_them():
    assert judged("right", 1.0, "none", 0.3, 0.3) == []
    assert [one.holds for one in judged("long", 1.015, "none", 5.7, 3.4)] == [True, True]
    assert [one.holds for one in judged("long", 1.015, "none", 0.7, 3.4)] == [False, True]
    assert [one.holds for one in judged("long", 1.015, "loop-finder", 0.02, 0.3)] == [True, False]
