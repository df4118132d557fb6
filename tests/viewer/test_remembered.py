"""What is seen in frames, remembered as long as it is seen the same way."""

from __future__ import annotations

import threading

from pseudolidar.viewer.remembered import REMEMBERED, RememberedSights


def test_a_frame_is_seen_once_as_long_as_it_is_one_of_the_last():
    seen = []
    sights = RememberedSights(lambda frame: seen.append(frame) or (frame,))
    frames = [object() for _ in range(REMEMBERED + 1)]
    assert sights(frames[0]) is sights(frames[0])
    for frame in frames:
        sights(frame)
    assert seen == frames
    sights(frames[0])
    assert seen == [*frames, frames[0]]


def test_what_was_begun_by_other_settings_is_not_remembered():
    begun, go, told = threading.Event(), threading.Event(), []

    def old(_frame):
        begun.set()
        go.wait(60)
        return "old"

    sights, frame = RememberedSights(old), object()
    sights.on_change(lambda: told.append("changed"))
    first = threading.Thread(target=lambda: told.append(sights(frame)))
    first.start()
    assert begun.wait(60)
    sights.change(lambda _frame: "new")  # waits for nobody
    assert told == ["changed"]
    go.set()
    first.join()
    assert told == ["changed", "old"]
    assert sights(frame) == "new"
