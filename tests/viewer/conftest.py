"""A real browser, and servers to point it at."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from pseudolidar.viewer.address import Address
from pseudolidar.viewer.server import GuardedServer, serve

# A headless Chromium that draws without a GPU, and asks nobody on the network for anything.
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
)


@contextmanager
def started_browser() -> Iterator[Browser]:
    """Chromium of the system; skips the test where there is none."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("no Chromium: apt-get install chromium, or make browser")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield started
        started.close()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One for all."""
    with started_browser() as started:
        yield started


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """A page that knows nothing yet."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    yield context.new_page()
    context.close()


@pytest.fixture
def slow_starts(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Threads called `late` and `film` begin slowly from now on; set when one of them begins to."""
    beginning, start = threading.Event(), threading.Thread.start

    def slowly(thread: threading.Thread) -> None:
        if thread.name in ("late", "film"):
            beginning.set()
            time.sleep(0.1)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", slowly)
    return beginning


@pytest.fixture
def server() -> Iterator[GuardedServer]:
    """A server with an empty scene."""
    started = serve(Address(port=0), label="test")
    yield started
    started.stop()
