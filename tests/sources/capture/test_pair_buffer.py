"""Pairs by time, the newest first, and every picture counted once."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import av
import numpy as np
import pytest

from pseudolidar.errors import CameraStalled, CaptureEnded, EyesApart, VideoDamaged
from pseudolidar.sources.capture.counts import CaptureCounts
from pseudolidar.sources.capture.eye_pairing import MOST_WAITING
from pseudolidar.sources.capture.pair_buffer import PairBuffer
from pseudolidar.sources.capture.shots import Shot
from pseudolidar.sources.capture.stamps import Stamp

MS = 1_000_000


def shot(ms: float) -> Shot:
    return Shot(av.VideoFrame(16, 16), Stamp(round(ms * MS), round(ms * MS)))


def buffer(eyes: int = 2, *, kept: int = 1, tolerance_s: float | None = None) -> PairBuffer:
    return PairBuffer(eyes, tolerance_s=tolerance_s, kept=kept, patience_s=60.0)


def fed(pairs: PairBuffer, left: list[float], right: list[float]) -> PairBuffer:
    """In order of time, as two cameras would deliver."""
    arrivals = sorted([(ms, 0) for ms in left] + [(ms, 1) for ms in right])
    for ms, eye in arrivals:
        pairs.put(eye, shot(ms))
    return pairs


def times(pairs: PairBuffer) -> Iterator[tuple[float, ...]]:
    """Times of the pairs that are there, ms."""
    while pairs.counts.waiting:
        yield tuple(one.stamp.time_ns / MS for one in pairs.take().shots)


def adds_up(counts: CaptureCounts) -> bool:
    pairs = counts.formed == counts.taken + counts.dropped + counts.waiting
    return pairs and all(
        eye.arrived == counts.formed + eye.alone + eye.waiting for eye in counts.eyes
    )


def test_of_the_pairs_that_wait_the_newest_wins() -> None:
    pairs = fed(buffer(), [0, 100, 200, 300], [1, 101, 201, 301])
    assert list(times(pairs)) == [(300, 301)]
    counts = pairs.counts
    assert (counts.formed, counts.dropped, counts.taken) == (4, 3, 1)
    assert counts.widest_ns == MS
    fed(pairs, [400], [401])
    assert list(times(pairs)) == [(400, 401)]
    assert adds_up(pairs.counts)


def test_more_may_wait_and_come_in_order() -> None:
    pairs = fed(buffer(kept=2), [0, 100, 200, 300], [1, 101, 201, 301])
    assert list(times(pairs)) == [(200, 201), (300, 301)]
    assert pairs.counts.dropped == 2


def test_a_picture_without_a_partner_is_left_out_whoever_misses_it() -> None:
    pairs = fed(buffer(kept=9), [0, 100, 300, 400, 500], [0, 100, 200, 300, 500])
    assert list(times(pairs)) == [(0, 0), (100, 100), (300, 300), (500, 500)]
    assert [eye.alone for eye in pairs.counts.eyes] == [1, 1]
    assert adds_up(pairs.counts)


def test_a_tolerance_beyond_half_an_interval_does_not_pair_with_the_farther_one() -> None:
    """Right pictures stand 30 ms before and 70 ms after the left ones."""
    left, right = [0, 100, 200, 300], [70, 170, 270, 370]
    pairs = fed(buffer(kept=9, tolerance_s=0.08), left, right)
    assert list(times(pairs)) == [(100, 70), (200, 170), (300, 270)]


def test_by_default_a_quarter_of_the_interval_at_most_ten_ms() -> None:
    assert len(list(times(fed(buffer(kept=9), [0, 100, 200], [9, 109, 209])))) == 3
    assert not list(times(fed(buffer(kept=9), [0, 100, 200], [11, 111, 211])))
    assert not list(times(fed(buffer(kept=9), [0, 20, 40], [6, 26, 46])))


def test_the_faster_camera_tells_how_near_is_near_enough() -> None:
    """A quarter of its interval of 20 ms."""
    fast, slow = [20.0 * i for i in range(20)], [100.0 * i for i in range(4)]
    near = fed(buffer(kept=9), [ms + 4.5 for ms in slow], fast)
    assert len(list(times(near))) == 4
    assert not list(times(fed(buffer(kept=9), [ms + 5.5 for ms in slow], fast)))


def test_a_pair_is_complete_with_its_later_picture_and_the_widest_is_told() -> None:
    pairs = fed(buffer(kept=9), [0, 100, 200], [3, 101, 200])
    assert pairs.take().taken_ns == 3 * MS
    assert pairs.counts.widest_ns == 3 * MS


def test_what_came_before_the_start_counts_no_more() -> None:
    pairs = fed(buffer(kept=9), [0, 100, 200, 300], [1, 101])
    pairs.forget()
    counts = pairs.counts
    assert (counts.formed, counts.taken, counts.waiting, counts.widest_ns) == (0, 0, 0, 0)
    assert [(eye.arrived, eye.alone, eye.waiting) for eye in counts.eyes] == [(0, 0, 0)] * 2
    fed(pairs, [400], [301, 401])
    assert list(times(pairs)) == [(400, 401)]
    assert adds_up(pairs.counts)


def test_an_eye_that_is_gone_does_not_fill_the_memory() -> None:
    pairs = fed(buffer(), [100.0 * i for i in range(200)], [0, 100])
    assert pairs.counts.eyes[0].waiting == MOST_WAITING
    assert adds_up(pairs.counts)


def test_a_clock_that_was_set_back_makes_no_earlier_pair() -> None:
    pairs = fed(buffer(kept=9), [0, 100, 200], [0, 100, 200])
    for eye in (0, 1):
        pairs.put(eye, shot(150))
        pairs.put(eye, shot(300))
    assert [pair[0] for pair in times(pairs)] == [0, 100, 200, 300]
    assert adds_up(pairs.counts)


def test_one_camera_with_both_eyes_needs_no_partner() -> None:
    pairs = buffer(eyes=1)
    for ms in (0, 100, 200):
        pairs.put(0, shot(ms))
    assert list(times(pairs)) == [(200,)]
    assert adds_up(pairs.counts)


def test_cameras_that_are_never_of_one_moment_are_told_how_far_apart_they_are() -> None:
    left = [100.0 * i for i in range(40)]
    pairs = fed(buffer(), left, [ms + 40 for ms in left])
    with pytest.raises(EyesApart, match="40 ms apart"):
        pairs.take()


def test_a_silent_camera_is_named() -> None:
    pairs = PairBuffer(2, tolerance_s=None, kept=1, patience_s=1e-6)
    with pytest.raises(CameraStalled, match="no picture for"):
        pairs.take()


def test_a_camera_that_is_silent_for_a_reason_says_the_reason() -> None:
    pairs = PairBuffer(2, tolerance_s=None, kept=1, patience_s=1e-6)
    pairs.failed(0, VideoDamaged("of another kind"))
    with pytest.raises(VideoDamaged, match="of another kind"):
        pairs.take()
    pairs.put(0, shot(0))  # it is back
    with pytest.raises(CameraStalled):
        pairs.take()


def test_what_is_there_is_handed_out_before_the_end_is_told() -> None:
    pairs = fed(buffer(), [0, 100], [0, 100])
    pairs.ended(0)
    assert pairs.take().time_ns == 100 * MS
    with pytest.raises(CaptureEnded, match="played"):
        pairs.take()
    fed(pairs, [200], [200])
    pairs.stop()
    with pytest.raises(CaptureEnded, match="stopped"):
        pairs.take()


def test_videos_of_one_picture_are_a_pair() -> None:
    pairs = fed(buffer(), [0], [0])
    assert not pairs.counts.formed
    pairs.ended(0)
    assert pairs.take().time_ns == 0


def test_many_threads_get_every_pair_once_and_wait_for_the_next() -> None:
    pairs, got = buffer(kept=4), []

    def work() -> None:
        try:
            while True:
                got.append(pairs.take().time_ns)
        except CaptureEnded:
            return

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for index in range(500):
        fed(pairs, [10.0 * index], [10.0 * index])
    pairs.ended(0)
    for thread in threads:
        thread.join()
    counts = pairs.counts
    assert adds_up(counts)
    assert counts.formed == 500
    assert len(got) == counts.taken == len(set(got))
    assert 499 * 10 * MS in got, "the last pair of all is nobody's to drop"


def test_the_interval_is_that_of_the_last_pictures() -> None:
    pairs = fed(buffer(), list(np.arange(0, 500, 50.0)), [0, 100])
    assert pairs.counts.eyes[0].interval_s == 0.05
    assert pairs.counts.as_dict()["cameras"]["right"]["interval_s"] == 0.1


def test_what_is_looked_at_first_is_of_one_moment_although_one_eye_is_ahead() -> None:
    pairs = fed(buffer(), [0, 100], [1, 101, 201])
    newest = pairs.pair_seen(0.0)
    assert [one.stamp.time_ns for one in newest.shots] == [100 * MS, 101 * MS]
    assert [one.stamp.time_ns for one in pairs.seen().shots] == [100 * MS, 201 * MS]
    assert pairs.counts.waiting == 1  # none was taken
    assert fed(buffer(), [0], [50]).pair_seen(0.0) is None
