"""Five at a page: one works, one reads, one stalls, one comes and goes, one is a browser.

All of them do the same again every `ROTA_S`, so that what the server holds can be compared from one
such turn to another.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import Page
from websockets.exceptions import WebSocketException

from tests.viewer import soaked_view
from tests.viewer.conftest import started_browser
from tests.viewer.served import Served, served
from tests.viewer.visitor import Visitor, cookie_of

# What is played: all of its frames are kept ready.
ARGUMENTS = ("synthetic:street:4",)
ROTA_S, SAMPLE_S = 60.0, 1.0
# All frames are made, all kernels loaded, every part of the page used; or longer before a long one.
WARM_TURNS, WARM_SHARE = 3, 1 / 6
# How long one reads nothing: less and more than a server waits for it (20 s).
STALLS_S = (8.0, 25.0)
# Growth that is allowed.
MOST_GROWTH = 0.05
COLOURS = ("photo", "height", "range", "sigma", "error", "plain")


@dataclass
class Soaked:
    """What was seen.

    Args:
        begun_s: when the warm-up ended.
        held: moments, s, and what the server held then, MB.
        frames: clouds that reached the one who reads all, since the warm-up.
        times: how often something was done, by its name.
        cpu_s: processor time of the server.
    """

    begun_s: float = 0.0
    held: list[tuple[float, float]] = field(default_factory=list)
    frames: int = 0
    times: dict[str, int] = field(default_factory=dict)
    cpu_s: float = 0.0

    def count(self, what: str) -> None:
        """One more."""
        self.times[what] = self.times.get(what, 0) + 1

    @property
    def ends_mb(self) -> tuple[float, float]:
        """Median of the last turn of the warm-up, and of the last turn at all, MB."""
        at_s, held_mb = np.array(self.held).T
        first = (at_s >= self.begun_s - ROTA_S) & (at_s < self.begun_s)
        last = at_s > at_s[-1] - ROTA_S
        return float(np.median(held_mb[first])), float(np.median(held_mb[last]))

    @property
    def growth(self) -> float:
        """Of the median, as a share."""
        first_mb, last_mb = self.ends_mb
        return last_mb / first_mb - 1

    @property
    def most_mb(self) -> float:
        """The most that was held after the warm-up."""
        return max(mb for at_s, mb in self.held if at_s >= self.begun_s)


def soaked(seconds: float, *, kept_bytes: int = 0) -> Soaked:
    """Serve, let them all in, and measure what the server holds.

    Args:
        seconds: after the warm-up; at least `ROTA_S`.
        kept_bytes: of each frame, by a server that leaks.
    """
    seen, ended = Soaked(), threading.Event()
    program = (soaked_view.__name__, str(kept_bytes))
    with served(ARGUMENTS, program=program) as server, _all_at_work(server, seen, ended):
        warm_s = max(WARM_TURNS * ROTA_S, WARM_SHARE * seconds)
        end_s = time.monotonic() + warm_s + seconds
        seen.begun_s = end_s - seconds
        while (now_s := time.monotonic()) < end_s:
            seen.held.append((now_s, server.held_mb))
            assert server.child.poll() is None, "\n".join(server.said)
            ended.wait(SAMPLE_S)
        seen.cpu_s = server.cpu_s
    return seen


@contextmanager
def _all_at_work(server: Served, seen: Soaked, ended: threading.Event) -> Iterator[None]:
    url, cookie = server.url, cookie_of(server.url)
    works = {
        "work": partial(_work, server),
        "read": _read_all,
        "stall": _stall,
        "come and go": _come_and_go,
    }
    threads = [
        threading.Thread(target=_kept_at, args=(name, work, url, cookie, seen, ended), name=name)
        for name, work in works.items()
    ]
    threads.append(threading.Thread(target=_browse, args=(url, seen, ended), name="browser"))
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        for thread in threads:
            thread.join()


Work = Callable[[Visitor, Soaked, threading.Event], None]


def _kept_at(
    name: str, work: Work, url: str, cookie: str, seen: Soaked, ended: threading.Event
) -> None:
    """Who is sent away comes back, as a browser does."""
    while not ended.is_set():
        with suppress(WebSocketException, OSError, TimeoutError):
            visitor = Visitor(url, cookie)
            seen.count(f"{name}: connected")
            try:
                work(visitor, seen, ended)
            finally:
                visitor.leave(rudely=True)
        ended.wait(0.5)


def _read_all(visitor: Visitor, seen: Soaked, ended: threading.Event) -> None:
    while not ended.is_set():
        before = _clouds(visitor)
        with suppress(TimeoutError):
            visitor.read(1.0)
        if time.monotonic() > seen.begun_s > 0:
            seen.frames += _clouds(visitor) - before


def _clouds(visitor: Visitor) -> int:
    return visitor.drawn.get("/map/rig/stereo", 0)


def _stall(visitor: Visitor, _seen: Soaked, ended: threading.Event) -> None:
    for stall_s in itertools.cycle(STALLS_S):
        end_s = time.monotonic() + 5.0
        while time.monotonic() < end_s and not ended.is_set():
            with suppress(TimeoutError):
                visitor.read(0.5)
        if ended.wait(stall_s):
            return


def _come_and_go(visitor: Visitor, _seen: Soaked, ended: threading.Event) -> None:
    while not ended.is_set() and not visitor.drawn:
        with suppress(TimeoutError):
            visitor.read(1.0)
    if visitor.read_bytes % 2:  # now so, now so
        visitor.leave()


def _work(server: Served, visitor: Visitor, seen: Soaked, ended: threading.Event) -> None:
    """One thing after the other, each at its time in the turn; what came is read between."""
    visitor.look((-8.0, 0.0, 5.0))
    rota = _rota()
    step_s = ROTA_S / len(rota)
    for name, act in itertools.cycle(rota.items()):
        end_s = server.begun_s + step_s * (int((time.monotonic() - server.begun_s) / step_s) + 1)
        act(visitor)
        seen.count(name)
        while (left_s := end_s - time.monotonic()) > 0:
            if ended.is_set():
                return
            with suppress(TimeoutError):
                visitor.read(left_s)


def _rota() -> dict[str, Callable[[Visitor], object]]:
    """A turn of somebody who tries everything; playing goes on at its end."""
    acts: dict[str, Callable[[Visitor], object]] = {}
    acts["step"] = lambda one: one.press(">")
    acts["play"] = lambda one: one.press("Play")
    for by in COLOURS:
        acts[f"colour by {by}"] = lambda one, by=by: one.turn("Colour", by)  # type: ignore[misc]
    acts["points larger"] = lambda one: one.turn("Point, m", 0.08)
    acts["points smaller"] = lambda one: one.turn("Point, m", 0.04)
    acts["scrub"] = lambda one: [one.turn("Frame", index) for index in (1, 3, 2, 0)]
    for step in range(4):
        acts[f"click {step}"] = lambda one, step=step: one.click((1.0, 0.1 * step, -0.1))  # type: ignore[misc]
    acts["look"] = lambda one: [one.look((-8.0, 0.5 * step, 5.0)) for step in range(10)]
    acts["pictures"] = lambda one: [
        one.fetch(f"/picture/view?kind={kind}") for kind in ("left", "disparity", "depth", "error")
    ]
    acts["pixels"] = lambda one: [
        one.fetch(f"/picture/pixel?x={x}&y=100&mark=1") for x in range(50, 450, 40)
    ]
    acts["box"] = lambda one: one.fetch("/picture/measure?left=250&top=60&right=330&bottom=110")
    acts["errors on"] = lambda one: one.turn("Errors of the shown frame", value=True)
    acts["aside"] = lambda one: one.turn("Arranged", "side by side")
    acts["over"] = lambda one: one.turn("Arranged", "over each other")
    acts["errors off"] = lambda one: one.turn("Errors of the shown frame", value=False)
    acts["obstacles"] = lambda one: one.turn("Detector", "labels")
    acts["list"] = lambda one: one.fetch("/obstacles/state")
    acts["no obstacles"] = lambda one: one.turn("Detector", "none")
    acts["tune"] = lambda one: one.turn("uniqueness, %", 12)
    acts["defaults"] = lambda one: one.press("Defaults")
    acts["take a cloud"] = lambda one: one.fetch("/export/cloud?name=stereo&kind=ply")
    acts["take the scene"] = lambda one: one.fetch("/export/scene")
    return acts


def _browse(url: str, seen: Soaked, ended: threading.Event) -> None:
    with started_browser() as browser:
        page = browser.new_page(viewport={"width": 640, "height": 480})
        page.set_default_timeout(5_000)
        page.goto(url, timeout=120_000)
        seen.count("browser: opened")
        for tab in itertools.cycle(("Scene", "Tune", "Obstacles", "Compare", "Export", "Help")):
            with suppress(BrowserError):  # busy, on a machine without a GPU
                _at_tab(page, tab)
                seen.count("browser: tab")
            if ended.wait(ROTA_S / 6):
                return


def _at_tab(page: Page, tab: str) -> None:
    page.get_by_role("tab", name=tab).click()
    page.mouse.move(200, 300)
    page.mouse.down()
    page.mouse.move(260, 280, steps=4)  # turn the scene
    page.mouse.up()
    page.mouse.click(220, 330)
