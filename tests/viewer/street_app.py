"""The viewer of a rendered street, a page that looks at it, and how tests find their way in it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page
from playwright.sync_api import Frame as InnerPage
from pseudolidar.pipelines.convert import Convert, ConvertFrame, opened

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.app import App
from pseudolidar.viewer.means import Means
from pseudolidar.viewer.opening import Opened
from pseudolidar.viewer.reel import SourceReel
from tests.viewer.seen import page_within

FRAMES, WIDTH_PX, HEIGHT_PX = 4, 512, 155


@contextmanager
def served_street() -> Iterator[App]:
    """Four frames with labels and a scan."""
    job = Convert(Synthetic("street", frames=FRAMES, width_px=WIDTH_PX))
    source = opened(job)
    sighted = SightFrame.of(
        MatchFrame.load(source, job.matcher, Refining(), SMALL_THINGS_KEPT), GroundFit()
    )
    reel = SourceReel(source, ConvertFrame.of(job, source).converted)
    with App.served(Address(port=0), Opened((reel,)), Means(sighted)) as served:
        yield served


@contextmanager
def page_of(app: App, browser: Browser, *scripts: str) -> Iterator[Page]:
    """A page with a frame in it; scripts run before its own."""
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    page = context.new_page()
    for script in scripts:
        page.add_init_script(script)
    page.goto(app.url)
    page.get_by_text(re.compile(rf"\d / {FRAMES}")).wait_for(timeout=60_000)
    yield page
    context.close()


def shown(page: Page, number: int) -> None:
    page.get_by_text(f"{number} / {FRAMES}").wait_for(timeout=60_000)


def pictures(page: Page) -> InnerPage:
    inner = page_within(page, "Pictures")
    inner.wait_for_selector("nav button")
    return inner


def objects_page(page: Page) -> InnerPage:
    page.get_by_role("tab", name="Obstacles").click()
    return page_within(page, "Obstacles")


def base(app: App) -> str:
    return app.url.split("?")[0]
