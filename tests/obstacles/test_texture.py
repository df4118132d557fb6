"""Where there is nothing to be matched a measure is not sure of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.obstacles.measure import measured
from pseudolidar.obstacles.texture import row_texture
from pseudolidar.structures.box import Detection
from tests.obstacles.scene import HEIGHT, WIDTH, box_px, sight

BOARD = ("board", 0.0, 8.0, 1.0, 1.0)


def shown(picture: np.ndarray):
    return replace(sight((BOARD,)), image=np.clip(np.rint(picture), 0, 255).astype(np.uint8))


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_shades_are_no_texture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    board = Detection("region", box_px(BOARD))
    shade = 60 + 0.3 * np.arange(WIDTH) + 2.0 * np.arange(HEIGHT)[:, None] % 80
    plain = shown(shade + 0.8 * rng.standard_normal((HEIGHT, WIDTH)))
    drawn = shown(shade + 20 * rng.standard_normal((HEIGHT, WIDTH)))
    assert row_texture(plain, board) < 0.1
    assert row_texture(drawn, board) > 0.95
    (unsure,), (sure,) = (measured(one, [board]) for one in (plain, drawn))
    assert unsure.confidence < 0.1
    assert sure.confidence > 0.6


def test_a_box_of_no_pixels_shows_nothing() -> None:
    assert row_texture(sight(()), Detection("region", (3.0, 3.0, 3.4, 9.0))) == 0.0
