"""What a browser shows: pictures, and pages within its page."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Frame as InnerPage
from playwright.sync_api import Page

# Screenshots stay here, to be looked at.
KEPT = Path(__file__).resolve().parents[2] / "out" / "viewer"
# Where the pages within the page come from, by their titles.
OWN_PAGES = {"Pictures": "picture", "Obstacles": "obstacles"}


def screenshot(page: Page, name: str) -> bytes:
    KEPT.mkdir(parents=True, exist_ok=True)
    return page.screenshot(path=KEPT / f"{name}.png")


def pixels_of(picture: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR))


def page_within(page: Page, title: str) -> InnerPage:
    """Our own page of that title, once it is there: its element comes before its address."""
    element = page.wait_for_selector(f'iframe[title="{title}"]')
    inner = None if element is None else element.content_frame()
    assert inner is not None
    inner.wait_for_url(re.compile(f"/{OWN_PAGES[title]}$"), timeout=60_000)
    return inner
