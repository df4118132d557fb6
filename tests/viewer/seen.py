"""Pictures that a browser or a server gives."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page

# Screenshots stay here, to be looked at.
KEPT = Path(__file__).resolve().parents[2] / "out" / "viewer"


def screenshot(page: Page, name: str) -> bytes:
    KEPT.mkdir(parents=True, exist_ok=True)
    return page.screenshot(path=KEPT / f"{name}.png")


def pixels_of(picture: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR))
