"""Holes are filled where their rim says what is in them, and never between two surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import StereoConfig
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.filters.filled_map import Surfaces
from pseudolidar.stereo.filters.filling_kernels import COLUMN_STEP, OCCLUSION, ROW_STEP, SURFACE
from pseudolidar.stereo.filters.filling_kernels import rim_distances as measure
from pseudolidar.structures.disparity import DisparityMap
from tests.stereo.pairs import frame

HEIGHT, WIDTH = 60, 120
BACKGROUND_GREY, FRONT_GREY = 60, 180


def scene(truth, *, hole, grey=None, sigma_px=0.3):
    """A frame whose picture shows two surfaces, and the map of `truth` without the pixels `hole`"""
    grey = np.where(truth > truth.min() + 5, FRONT_GREY, BACKGROUND_GREY) if grey is None else grey
    image = np.broadcast_to(grey, truth.shape).astype(np.uint8)
    values = np.where(hole, np.nan, truth).astype(np.float32)
    sigma = np.where(hole, np.nan, sigma_px).astype(np.float32)
    return frame(image, image, baseline_m=0.1), DisparityMap(values, sigma)


def grid():
    return np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)


def test_rim_distances_are_those_of_a_walk():
    rng = np.random.default_rng(3)
    valid = rng.uniform(size=(19, 23)) < 0.2
    found = np.empty((8, 19, 23), np.int16)
    measure(valid, 6, found)
    for k in range(8):
        for y in range(19):
            for x in range(23):
                walked = 0
                for steps in range(1, 7):
                    v, u = y + steps * ROW_STEP[k], x + steps * COLUMN_STEP[k]
                    if not (0 <= v < 19 and 0 <= u < 23):
                        break
                    if valid[v, u]:
                        walked = steps
                        break
                assert found[k, y, x] == walked, (k, y, x)


def test_a_hole_in_a_slanted_plane_takes_the_plane():
    y, x = grid()
    truth = 20 + 0.2 * y - 0.1 * x
    hole = (abs(y - 30) < 5) & (abs(x - 60) < 8)
    pair, measured = scene(truth, hole=hole, grey=BACKGROUND_GREY)
    filled, counts = Surfaces().load()(pair, measured)
    assert filled.valid.all()
    np.testing.assert_allclose(filled.values, truth, atol=1e-4)
    assert counts == {"pixels_filled_on_surfaces": hole.sum(), "pixels_filled_in_shadows": 0}
    assert (filled.sigma[hole] > 0.3).all()
    np.testing.assert_array_equal(filled.sigma[~hole], measured.sigma[~hole])


@pytest.mark.parametrize("step_px", [3.0, 10.0, 30.0])
def test_a_hole_across_a_step_is_not_bridged(step_px):
    """The picture is even, so that geometry alone must tell."""
    _, x = grid()
    truth = np.where(x < 60, 10 + step_px, 10)  # the nearer surface is on the left: no shadow
    hole = abs(x - 60) < 6
    pair, measured = scene(truth, hole=hole, grey=BACKGROUND_GREY)
    filled, _ = Surfaces().load()(pair, measured)
    assert not (filled.valid & hole).any()


def shadow(*, run=14, step_px=14.0):
    _, x = grid()
    truth = np.where(x < 60, 10, 10 + step_px).astype(np.float32)
    return truth, (x >= 60 - run) & (x < 60)


def test_a_shadow_takes_the_background():
    truth, hole = shadow()
    pair, measured = scene(truth, hole=hole)
    filling = Surfaces().load().filling(pair, measured)
    assert (filling.kind[hole] == OCCLUSION).all()
    np.testing.assert_array_equal(filling.values[hole], 10)
    # The farther from the background, the less sure.
    assert (np.diff(filling.sigma[30, 46:60]) > 0).all()


@pytest.mark.parametrize("why", ["wider than the step hides", "of the colour of the front"])
def test_what_is_no_shadow_stays_a_hole(why):
    truth, hole = shadow(run=30) if why.startswith("wider") else shadow()
    grey = np.where(hole, FRONT_GREY, np.where(truth > 15, FRONT_GREY, BACKGROUND_GREY))
    pair, measured = scene(truth, hole=hole, grey=grey if why.startswith("of") else None)
    filled, _ = Surfaces().load()(pair, measured)
    assert not (filled.valid & hole).any()


def test_the_open_sky_stays_empty():
    y, x = grid()
    truth = np.full((HEIGHT, WIDTH), 12.0)
    sky = (y < 25) & (abs(x - 60) < 7)  # between two houses of one depth
    pair, measured = scene(truth, hole=sky, grey=BACKGROUND_GREY)
    filled, _ = Surfaces().load()(pair, measured)
    assert not (filled.valid & sky).any()


def test_a_window_of_another_colour_stays_empty():
    y, x = grid()
    hole = (abs(y - 30) < 5) & (abs(x - 60) < 8)
    pair, measured = scene(
        np.full((HEIGHT, WIDTH), 12.0), hole=hole, grey=np.where(hole, FRONT_GREY, BACKGROUND_GREY)
    )
    assert not (Surfaces().load()(pair, measured)[0].valid & hole).any()


@pytest.mark.parametrize(
    ("settings", "stays"),
    [
        (Surfaces(), False),
        (Surfaces(largest_px=10), True),
        (Surfaces(largest_m=0.1), True),  # 15 px x 0.1 m / 10 px = 0.15 m
        (Surfaces(largest_m=0.2), False),
        (Surfaces(max_depth_m=1.9), True),  # 200 px x 0.1 m / 10 px = 2 m
        (Surfaces(max_depth_m=2.1), False),
    ],
)
def test_caps_on_size_and_depth(settings, stays):
    y, x = grid()
    hole = (abs(y - 30) < 5) & (abs(x - 60) < 8)
    pair, measured = scene(np.full((HEIGHT, WIDTH), 10.0), hole=hole, grey=BACKGROUND_GREY)
    filled, _ = settings.load()(pair, measured)
    assert (filled.valid & hole).any() != stays


def test_unsure_rims_are_no_ground_to_stand_on():
    y, x = grid()
    hole = (abs(y - 30) < 5) & (abs(x - 60) < 8)
    truth = np.full((HEIGHT, WIDTH), 10.0)
    pair, measured = scene(truth, hole=hole, grey=BACKGROUND_GREY, sigma_px=2.0)
    assert not (Surfaces().load()(pair, measured)[0].valid & hole).any()


@pytest.mark.parametrize("world", ["street", "room"])
def test_no_filled_pixel_of_a_world_lies_between_two_surfaces(world):
    """Holes are cut into exact truth; what fills them must be a surface that is near there."""
    pair = Synthetic(world, width_px=640).open().load(3)
    truth = pair.truth.values
    rng = np.random.default_rng(8)
    hole = ~np.isfinite(truth)
    for _ in range(400):
        y, x = rng.integers(0, truth.shape[0]), rng.integers(0, truth.shape[1])
        half = rng.integers(1, 9, 2)
        hole[max(y - half[0], 0) : y + half[0], max(x - half[1], 0) : x + half[1]] = True
    sigma = np.where(hole, np.nan, np.float32(0.2)).astype(np.float32)
    measured = DisparityMap(np.where(hole, np.float32(np.nan), truth), sigma)
    filling = Surfaces().load().filling(pair, measured)
    filled = filling.kind > 0
    assert (filling.kind == SURFACE).sum() > 2000
    # Nearest and farthest surface around each pixel; sky counts as disparity 0.
    from scipy.ndimage import maximum_filter, minimum_filter

    known = np.nan_to_num(truth)
    low, high = minimum_filter(known, 17), maximum_filter(known, 17)
    step = high - low > np.maximum(3.0, 0.1 * high)
    between = (filling.values > low + 0.25 * (high - low)) & (
        filling.values < high - 0.25 * (high - low)
    )
    wrong = np.abs(filling.values - known) > np.maximum(1.0, 0.05 * known)
    assert (filled & step & between & wrong).sum() <= 0.002 * filled.sum()
    assert (filled & wrong).sum() <= 0.02 * filled.sum()
    # The sky: but for single pixels with one surface all around, as between twigs.
    assert (filled & ~np.isfinite(truth)).sum() <= 2


@pytest.mark.parametrize("settings", [{"largest_px": 0}, {"largest_m": -1.0}, {"largest_px": 1e9}])
def test_caps_that_mean_nothing_are_refused(settings):
    with pytest.raises(StereoConfig):
        Surfaces(**settings)
