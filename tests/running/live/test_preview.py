"""`live.jpg`: the newest frame, and a run that does not depend on it."""

from __future__ import annotations

import io
import threading
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pseudolidar.running.live.preview import LivePreview, PairPicture
from pseudolidar.sources.capture.eyes import Eyes
from tests.sources.capture.test_eyes import shots

PATIENCE_S = 60.0


def test_the_newest_is_drawn_and_the_last_one_stays(tmp_path: Path) -> None:
    drawing, drawn = threading.Event(), threading.Event()

    def draw(word: str) -> bytes:
        drawing.set()
        assert drawn.wait(PATIENCE_S)
        return word.encode()

    path = tmp_path / "live.jpg"
    with LivePreview(path, draw, pause_s=0.01) as preview:
        preview.show(0, "first")
        assert drawing.wait(PATIENCE_S)
        for number, word in ((2, "last"), (1, "older")):  # meanwhile, from two workers
            preview.show(number, word)
        drawn.set()
    assert path.read_bytes() == b"last"
    assert [found.name for found in tmp_path.iterdir()] == ["live.jpg"]


def test_a_preview_that_cannot_be_written_is_told_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "live.jpg").mkdir()
    with LivePreview(tmp_path / "live.jpg", str.encode, pause_s=0.01) as preview:
        for number in range(3):
            preview.show(number, "picture")
    (told,) = (record for record in caplog.records if record.levelname == "WARNING")
    assert "no more previews" in told.getMessage()


def test_both_eyes_are_side_by_side_with_words_below() -> None:
    left, right = (np.full((600, 800), grey, np.uint8) for grey in (60, 180))
    draw = PairPicture(Eyes(), lambda: "hold it where it was not yet")
    picture = np.asarray(Image.open(io.BytesIO(draw(shots(left, right)))))
    assert picture.shape == (510, 1280, 3)
    assert np.abs(picture[100:480, 10:630].astype(int) - 60).max() < 5
    assert np.abs(picture[100:480, 650:].astype(int) - 180).max() < 5
    assert picture[480:].max() > 200
