"""A patch matched as a whole: to a fiftieth of a pixel, or not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.obstacles.patch import patch_depth
from pseudolidar.structures.box import Detection
from pseudolidar.structures.correction import DisparityCorrection
from tests.obstacles.scene import BASELINE_M, FOCAL_PX, HEIGHT, RIG, WIDTH, sight

FB = FOCAL_PX * BASELINE_M
BOX = (300.0, 100.0, 323.0, 121.0)


def light(u: np.ndarray, v: np.ndarray, *, period: float | None = None) -> np.ndarray:
    """A pattern that is known between the pixels too: waves of many directions."""
    rng = np.random.default_rng(4)
    total = np.zeros(np.broadcast(u, v).shape)
    for _ in range(40):
        fu, fv, phase = (
            rng.uniform(-0.18, 0.18),
            rng.uniform(-0.18, 0.18),
            rng.uniform(0, 2 * np.pi),
        )
        if period is not None:
            fu = np.round(fu * period) / period
        total += np.cos(2 * np.pi * (fu * u + fv * v) + phase)
    return 128 + 7 * total


def pair(disparity_px: float, *, gain: float = 1.0, noise: float = 1.0, period=None, seed: int = 0):
    u, v = np.arange(WIDTH)[None, :], np.arange(HEIGHT)[:, None]
    rng = np.random.default_rng(seed)
    eyes = [
        light(u, v, period=period),
        gain * light(u + disparity_px, v, period=period) + 10 * (gain != 1),
    ]
    eyes = [one + noise * rng.standard_normal(one.shape) for one in eyes]
    left, right = (np.clip(np.round(one), 0, 255).astype(np.uint8) for one in eyes)
    return replace(sight(()), image=left, right=right)


@pytest.mark.parametrize("disparity_px", [3.0, 7.31, 20.5, 41.87])
@pytest.mark.parametrize("gain", [1.0, 0.8])
def test_depth_is_right_to_a_fiftieth_of_a_pixel(disparity_px: float, gain: float) -> None:
    found = patch_depth(pair(disparity_px, gain=gain), Detection("region", BOX))
    assert FB / found.depth_m == pytest.approx(disparity_px, abs=0.03)
    assert found.correlation > 0.9


def test_its_error_is_the_one_it_tells() -> None:
    small = Detection("region", (300.0, 100.0, 311.0, 111.0))
    found = [patch_depth(pair(8.4, noise=4.0, seed=seed), small) for seed in range(40)]
    off = [(one.depth_m - FB / 8.4) / one.sigma_m for one in found if one is not None]
    assert len(off) > 30
    assert 0.5 < np.mean(np.abs(off) < 1) < 0.95


def test_the_rig_takes_its_systematic_error_off() -> None:
    seen = pair(20.5)
    correction = DisparityCorrection(np.array([0.5, 0, 0, 0, 0, 0, 0, 0, 0, 0]), 0.1)
    mended = replace(seen, rig=RIG.with_correction(correction))
    raw, found = (patch_depth(one, Detection("region", BOX)) for one in (seen, mended))
    assert FB / found.depth_m == pytest.approx(FB / raw.depth_m - 0.5, abs=1e-6)


def test_what_does_not_tell_says_nothing() -> None:
    seen, box = pair(12.0), Detection("region", BOX)
    plain = np.full((HEIGHT, WIDTH), 90, np.uint8)
    assert patch_depth(replace(seen, image=plain), box) is None
    assert patch_depth(replace(seen, right=plain), box) is None
    assert patch_depth(replace(seen, right=None), box) is None
    assert patch_depth(replace(seen, rig=None), box) is None
    # a pattern that repeats within the row has no one place
    assert patch_depth(pair(12.0, period=25.0), box) is None
    for edges in ((300.0, 100.0, 301.0, 121.0), (10.0, 10.0, 400.0, 200.0)):
        assert patch_depth(seen, Detection("region", edges)) is None


def test_its_colour_tells_it_from_places_with_the_same_pattern() -> None:
    """A red patch on a grey wall whose pattern repeats."""
    grey = pair(12.0, period=25.0)
    eyes = []
    for eye, moved in ((grey.image, 0), (grey.right, 12)):
        colours = np.repeat(eye[:, :, None], 3, axis=2)
        colours[95:127, 295 - moved : 329 - moved, 1:] //= 2
        eyes.append(colours)
    seen = replace(grey, image=eyes[0], right=eyes[1])
    found = patch_depth(seen, Detection("region", BOX))
    assert FB / found.depth_m == pytest.approx(12.0, abs=0.05)
    # of a brighter eye, too
    brighter = np.minimum(eyes[1] * 1.25, 255).astype(np.uint8)
    found = patch_depth(replace(seen, right=brighter), Detection("region", BOX))
    assert FB / found.depth_m == pytest.approx(12.0, abs=0.1)
