"""A timeline that is told what time it is."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pseudolidar.errors import StructureError
from pseudolidar.viewer.timeline import LONGEST_WAIT_S, Timeline


def tenths(count: int = 5, **settings: object) -> Timeline:
    return Timeline(np.arange(count) / 10, **settings)  # type: ignore[arg-type]


def played(timeline: Timeline, seconds: float, tick_s: float = 0.01) -> list[int]:
    """The frames that are shown while it plays, each ready at once."""
    shown = [timeline.index]
    for now in np.arange(0, seconds, tick_s):
        if timeline.due(now):
            timeline.advance(now)
            shown.append(timeline.index)
    return shown


def test_it_stays_until_it_plays():
    timeline = tenths()
    assert not timeline.due(1e9)
    timeline.play(0.0)
    assert not timeline.due(0.05)
    assert timeline.due(0.1)


def test_it_plays_at_the_pace_of_the_recording():
    timeline = tenths(11, loop=False)
    timeline.play(0.0)
    shown = played(timeline, 0.55)
    assert shown == [0, 1, 2, 3, 4, 5]


def test_twice_as_fast_shows_twice_as_many():
    timeline = tenths(100, speed=2.0)
    timeline.play(0.0)
    assert len(played(timeline, 1.01)) == pytest.approx(21, abs=1)


def test_it_begins_again_or_ends():
    timeline = tenths(3)
    timeline.play(0.0)
    assert played(timeline, 0.45) == [0, 1, 2, 0, 1]
    timeline = tenths(3, loop=False)
    timeline.play(0.0)
    assert played(timeline, 2.0) == [0, 1, 2]
    assert not timeline.playing
    timeline.play(5.0)
    assert timeline.index == 0


def test_what_came_late_does_not_hurry_the_rest():
    timeline = tenths(100)
    timeline.play(0.0)
    timeline.advance(3.0)  # it was not ready before
    assert not timeline.due(3.05)
    assert timeline.due(3.1)


def test_pauses_of_a_recording_are_not_waited_for():
    timeline = Timeline([0.0, 3600.0])
    timeline.play(0.0)
    assert timeline.due(LONGEST_WAIT_S)


def test_stepping_pauses_and_goes_round():
    timeline = tenths(3)
    timeline.play(0.0)
    timeline.step(-1, 0.0)
    assert (timeline.index, timeline.playing) == (2, False)
    timeline.loop = False
    timeline.step(1, 0.0)
    assert timeline.index == 2


def test_what_comes_next_is_known():
    timeline = tenths(5)
    timeline.jump(3, 0.0)
    assert timeline.ahead(3) == (3, 4, 0)
    assert timeline.ahead(99) == (3, 4, 0, 1, 2)
    timeline.loop = False
    assert timeline.ahead(3) == (3, 4)


def test_one_frame_is_a_sequence_too():
    timeline = tenths(1)
    timeline.play(0.0)
    assert not timeline.due(99.0)
    timeline.step(1, 0.0)
    assert timeline.index == 0


def test_no_frames_and_no_speed_are_errors():
    with pytest.raises(StructureError):
        Timeline([])
    for speed in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(StructureError):
            tenths().set_speed(speed, 0.0)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # on busy machines
@given(
    st.lists(st.floats(0, 2), min_size=1, max_size=20),
    st.lists(st.sampled_from(["play", "step", "back", "jump", "tick"]), max_size=40),
    st.booleans(),
)
def test_it_never_leaves_the_sequence(steps, actions, loop):
    timeline = Timeline(np.cumsum(steps), loop=loop)
    now = 0.0
    for action in actions:
        now += 0.3
        match action:
            case "play":
                timeline.play(now)
            case "step":
                timeline.step(1, now)
            case "back":
                timeline.step(-1, now)
            case "jump":
                timeline.jump(17, now)
            case "tick" if timeline.due(now):
                timeline.advance(now)
        assert 0 <= timeline.index < len(timeline)
        assert timeline.ahead(4)[0] == timeline.index
