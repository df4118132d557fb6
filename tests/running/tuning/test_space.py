from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.running.tuning.space import Candidate, Choice, Number, Space
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.stereo.sgbm import Bm, Sgbm

STARTS = [
    Candidate(Census()),
    Candidate(Census(quality="fine", disparities=64), Fgs(strength=900)),
    Candidate(Sgbm(block_size=3)),
    Candidate(Sgbm(), fill=Surfaces()),
    Candidate(Bm()),
]


@pytest.mark.parametrize("start", STARTS)
def test_every_place_is_a_legal_candidate(start):
    space = Space.around(start)
    rng = np.random.default_rng(0)
    corners = [np.zeros(len(space.names)), np.ones(len(space.names))]
    for place in [*corners, *rng.random((200, len(space.names)))]:
        candidate = space.candidate(place)
        assert type(candidate.matcher) is type(start.matcher)
        assert candidate.matcher.disparities == start.matcher.disparities
        candidate.matcher.load()
        assert (candidate.fill is None) == (start.fill is None)


@pytest.mark.parametrize("start", STARTS)
def test_the_origin_is_the_start(start):
    space = Space.around(start)
    again = space.candidate(space.origin)
    assert space.place(again) == pytest.approx(space.origin, abs=0.02)
    if isinstance(start.matcher, Census):
        assert (again.matcher.small, again.matcher.agreement) == (
            start.matcher.small,
            start.matcher.agreement,
        )
    elif isinstance(start.matcher, Sgbm):
        assert again.matcher.penalties == start.matcher.penalties
    assert again.smooth == start.smooth


def test_what_is_kept_stays():
    start = Candidate(Census(quality="fine"))
    space = Space.around(start, keep=("matcher.quality", "smooth"))
    assert not any(name.startswith("smooth") for name in space.names)
    for place in np.random.default_rng(1).random((20, len(space.names))):
        candidate = space.candidate(place)
        assert (candidate.matcher.quality, candidate.smooth) == ("fine", None)


@pytest.mark.parametrize("keep", [("matcher.speed",), ("fill",), ("matcher", "smooth")])
def test_nothing_unknown_is_kept_and_not_everything(keep):
    with pytest.raises(UsageError):
        Space.around(Candidate(Census()), keep=keep)


def test_numbers_have_ends_steps_and_ratios():
    whole, ratio = Number("a", 3, 24), Number("b", 1, 100, log=True, step=0.5)
    assert (whole.value(0), whole.value(1)) == (3, 24)
    assert isinstance(whole.value(0.31), int)
    assert ratio.value(0.5) == 10.0
    assert ratio.unit(10) == pytest.approx(0.5)
    assert (whole.unit(99), whole.unit(-5)) == (1.0, 0.0)
    choice = Choice("c", ("x", "y", "z"))
    assert [choice.value(unit) for unit in (0, 0.34, 1)] == ["x", "y", "z"]
    assert choice.value(choice.unit("y")) == "y"
