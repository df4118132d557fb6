"""When pictures were taken, by clocks whose times are chosen here."""

from __future__ import annotations

import threading
import time

import pytest

from pseudolidar.sources.capture.stamps import (
    SLIP_NS,
    DriverClock,
    Epoch,
    Pace,
    PlayClock,
    Stamp,
    StreamClock,
)
from pseudolidar.sources.stamps import START_NS

MS, S = 1_000_000, 1_000_000_000


def test_a_driver_stamps_by_either_clock_of_the_machine() -> None:
    epoch = Epoch()
    clock = DriverClock(epoch)
    monotonic = time.monotonic_ns() - 5 * MS
    assert clock.stamp(monotonic) == Stamp(monotonic + epoch.wall_ns, monotonic)
    wall = time.monotonic_ns() + epoch.wall_ns - 5 * MS
    assert clock.stamp(wall) == Stamp(wall, wall - epoch.wall_ns)


@pytest.mark.parametrize("media_ns", [None, -(10**15), 7 * 10**18])
def test_a_driver_that_says_nothing_that_can_be_meant_is_not_believed(media_ns: int | None) -> None:
    epoch = Epoch()
    before = time.monotonic_ns()
    stamp = DriverClock(epoch).stamp(media_ns)
    assert before <= stamp.taken_ns <= time.monotonic_ns()
    assert stamp.time_ns == stamp.taken_ns + epoch.wall_ns


def test_two_streams_are_moved_by_the_same_time() -> None:
    epoch = Epoch()
    left, right = StreamClock(epoch), StreamClock(epoch)
    first = left.stamp(7 * S)
    assert right.stamp(7 * S + 3 * MS).time_ns - first.time_ns == 3 * MS
    assert left.stamp(8 * S).time_ns - first.time_ns == S
    # It was taken when it arrived.
    assert first.taken_ns <= first.time_ns - epoch.wall_ns <= time.monotonic_ns()


def test_a_stream_that_begins_anew_goes_on_after_the_time_that_passed() -> None:
    clock = StreamClock(Epoch())
    last = clock.stamp(50 * S)
    clock.begin()
    again = clock.stamp(0)
    assert again.time_ns - last.time_ns == max(1, again.taken_ns - last.taken_ns)
    assert clock.stamp(40 * MS).time_ns - again.time_ns == 40 * MS


def stopped(eyes: int, speed: float) -> Pace:
    """A pace that says when pictures are due, and waits for none."""
    stop = threading.Event()
    stop.set()
    return Pace(eyes, speed, stop)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_pictures_are_due_by_the_speed(speed: float) -> None:
    pace = stopped(1, speed)
    pace.wait(0, 30 * S, S)
    before = time.monotonic_ns()
    pace.begin()
    due = [pace.wait(0, 30 * S + after, S) for after in (0, 10 * S, 20 * S)]
    assert before <= due[0] <= time.monotonic_ns()
    assert due[1] - due[0] == pytest.approx(10 * S / speed, abs=2000)
    assert due[2] - due[1] == pytest.approx(10 * S / speed, abs=2000)
    assert pace.slipped_ns == 0


def test_what_falls_behind_goes_on_from_there() -> None:
    pace = stopped(1, 1.0)
    pace.wait(0, 10 * S, S)
    pace.begin()
    behind = 2 * SLIP_NS
    late = pace.wait(0, 10 * S - behind, S)
    slipped = pace.slipped_ns
    assert slipped >= behind
    on_time = pace.wait(0, 20 * S - behind, S)
    assert on_time - late == pytest.approx(10 * S, abs=2000)
    assert pace.slipped_ns == slipped


def test_an_eye_at_its_end_is_not_waited_for() -> None:
    pace = Pace(2, 1000.0, threading.Event())
    for eye in (0, 1):
        pace.wait(eye, 0, 0)
    pace.begin()
    other = threading.Thread(target=pace.wait, args=(0, S, MS), daemon=True)
    other.start()
    pace.leave(1)
    other.join(60)
    assert not other.is_alive()


def test_played_pictures_have_their_own_times_or_those_of_the_rate() -> None:
    clock = PlayClock(stopped(1, 1.0), 0, 40 * MS)
    assert [clock.stamp(None).time_ns for _ in range(3)] == [
        START_NS + after for after in (0, 40 * MS, 80 * MS)
    ]
    assert clock.stamp(7 * S).time_ns == START_NS + 7 * S
