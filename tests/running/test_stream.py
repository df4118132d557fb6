import threading

import cv2
import pytest

from pseudolidar.errors import FrameError, ImageMissing, PairMismatch, UsageError
from pseudolidar.running.crew.attempt import Done, Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.stream import IN_FLIGHT_PER_WORKER, stream


def pixel_sum(frame):
    return int(frame.left.sum())


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_order_and_do_not_depend_on_workers(texture_source, workers):
    source = texture_source(23)
    done = list(stream(source, pixel_sum, crew=CrewPlan(workers)))
    assert [frame.id for frame in done] == list(source.ids)
    assert [frame.value for frame in done] == [pixel_sum(source.load(i)) for i in range(23)]


@pytest.mark.parametrize("workers", [0, -1])
def test_no_workers_is_refused(texture_source, workers):
    with pytest.raises(UsageError, match="--workers"):
        list(stream(texture_source(2), pixel_sum, crew=CrewPlan(workers)))


def test_order_holds_when_early_frames_are_slow(texture_source):
    release = threading.Event()

    def first_waits_for_the_third(frame):
        if frame.index == 2:
            release.set()
        if frame.index == 0:
            assert release.wait(60)
        return frame.index

    done = stream(texture_source(6), first_waits_for_the_third, crew=CrewPlan(2))
    assert [frame.value for frame in done] == list(range(6))


def test_frames_run_at_the_same_time(texture_source):
    both = threading.Barrier(2)

    def meet(frame):
        both.wait(60)
        return threading.get_ident()

    assert len({frame.value for frame in stream(texture_source(2), meet, crew=CrewPlan(2))}) == 2


def test_frames_in_flight_are_bounded(texture_source):
    started, consumed, ahead = [], 0, 0

    def note(frame):
        started.append(frame.index)

    for _ in stream(texture_source(60), note, crew=CrewPlan(3)):
        consumed += 1
        ahead = max(ahead, len(started) - consumed)
    assert consumed == 60
    assert ahead <= 3 * IN_FLIGHT_PER_WORKER


def test_skipped_ids_are_not_loaded(texture_source):
    source = texture_source(4, bad={1: AssertionError("loaded")})
    done = list(stream(source, pixel_sum, crew=CrewPlan(2), skip={"000001"}))
    assert [frame.id for frame in done] == ["000000", "000002", "000003"]
    assert all(isinstance(frame, Done) for frame in done)


def test_a_bad_frame_is_a_value(texture_source):
    missing = ImageMissing("no file", path="left.png")
    source = texture_source(3, bad={1: missing}, refused=(("x", PairMismatch("one eye")),))
    refused, first, bad, last = stream(source, pixel_sum, crew=CrewPlan(2))
    assert (refused.id, refused.index, refused.error.code) == ("x", None, "PairMismatch")
    assert isinstance(first, Done)
    assert isinstance(last, Done)
    assert (bad.id, bad.index, bad.error) == ("000001", 1, missing)
    assert missing.__traceback__ is None, "a traceback keeps the frame's arrays alive"


def test_an_unexpected_failure_is_wrapped_with_its_traceback(texture_source):
    def broken(frame):
        raise ZeroDivisionError("by accident")

    (bad,) = stream(texture_source(1), broken, crew=CrewPlan(1))
    assert isinstance(bad, Skipped)
    assert isinstance(bad.error, FrameError)
    assert "ZeroDivisionError: by accident" in str(bad.error)
    assert "in broken" in bad.trace


def test_opencv_uses_one_thread_meanwhile(texture_source):
    before = cv2.getNumThreads()
    (frame,) = stream(texture_source(1), lambda frame: cv2.getNumThreads(), crew=CrewPlan(1))
    assert frame.value == 1
    assert cv2.getNumThreads() == before


def test_leaving_early_finishes_what_has_begun_and_starts_nothing_more(texture_source):
    started, second, release = [], threading.Event(), threading.Event()
    of_others = set(threading.enumerate())

    def second_waits(frame):
        started.append(frame.index)
        if frame.index == 1:
            second.set()
            assert release.wait(60)

    frames = stream(texture_source(50), second_waits, crew=CrewPlan(1))
    next(frames)
    assert second.wait(60)
    threading.Timer(0.1, release.set).start()
    frames.close()
    assert started == [0, 1]
    own = set(threading.enumerate()) - of_others
    assert not [thread for thread in own if thread.name.startswith("frame-worker")]


def test_results_are_let_go(texture_source):
    alive, most = [0], [0]
    lock = threading.Lock()

    class Held:
        def __init__(self):
            with lock:
                alive[0] += 1
                most[0] = max(most[0], alive[0])

        def __del__(self):
            with lock:
                alive[0] -= 1

    for _ in stream(texture_source(40), lambda frame: Held(), crew=CrewPlan(2)):
        pass
    assert most[0] <= 2 * IN_FLIGHT_PER_WORKER + 3
