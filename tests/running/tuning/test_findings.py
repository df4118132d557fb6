"""What is said of settings that were found."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pseudolidar.running.tuning.findings import Figures, Found
from pseudolidar.running.tuning.space import Candidate
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.sgbm import Bm, Sgbm

FIGURES = Figures(0.1, 0.9, None, None, 0.01)


def found(start, now):
    return Found(Candidate(now), Candidate(start), 0.9, 0.9, FIGURES, FIGURES)


@pytest.mark.parametrize(("matcher", "kind"), [(Sgbm(), "SGBM"), (Bm(), "BM")])
def test_pairs_alone_are_doubted_for_costs_that_they_hardly_judge(matcher, kind):
    better = found(matcher, replace(matcher, uniqueness_percent=3))
    (line,) = better.doubts("pairs")
    assert kind in line
    assert "--matcher census" in line
    assert better.doubts("truth") == better.doubts("scan") == ()
    assert found(matcher, matcher).doubts("pairs") == ()


def test_census_by_pairs_is_not_doubted():
    assert found(Census(), Census(quality="fine")).doubts("pairs") == ()
