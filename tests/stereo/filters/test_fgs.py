"""The fast global smoother: solved exactly, true to slopes and edges, honest about sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_banded

from pseudolidar.errors import StereoConfig
from pseudolidar.stereo.filters.fgs import ATTENUATION, ITERATIONS, Links, smooth_surfaces
from pseudolidar.stereo.filters.fgs_kernels import solve_columns, weighed_slopes
from pseudolidar.stereo.filters.smoothed_map import Fgs
from pseudolidar.structures.disparity import DisparityMap
from tests.stereo.pairs import frame

RNG = np.random.default_rng(5)


def solved_column(weights, strength, values):
    """(I + strength L) u = f of one chain by LAPACK."""
    n = len(values)
    link = strength * weights[: n - 1].astype(np.float64)
    bands = np.zeros((3, n))
    bands[0, 1:] = bands[2, :-1] = -link
    bands[1] = 1.0
    bands[1, :-1] += link
    bands[1, 1:] += link
    return solve_banded((1, 1), bands, values.astype(np.float64))


def smoothed_oracle(values, confidence, guide, strength, sigma_color):
    """The smoother without slopes, straight from the paper, in double precision."""
    steps_x = np.sqrt((np.diff(guide.astype(float), axis=1) ** 2).sum(axis=2))
    steps_y = np.sqrt((np.diff(guide.astype(float), axis=0) ** 2).sum(axis=2))
    w_x, w_y = np.exp(-steps_x / sigma_color), np.exp(-steps_y / sigma_color)
    maps = [values * confidence, confidence.astype(np.float64)]
    for t in range(1, ITERATIONS + 1):
        lam = 1.5 * ATTENUATION ** (ITERATIONS - t) / (ATTENUATION**ITERATIONS - 1) * strength
        for k in range(2):
            m = maps[k]
            m = np.stack([solved_column(w_x[y], lam, m[y]) for y in range(len(m))])
            columns = range(m.shape[1])
            maps[k] = np.stack([solved_column(w_y[:, x], lam, m[:, x]) for x in columns], axis=1)
    return maps[0] / maps[1]


@pytest.mark.parametrize("shape", [(1, 7), (2, 1), (23, 17)])
@pytest.mark.parametrize("strength", [0.3, 8000.0])
def test_columns_are_solved_as_by_lapack(shape, strength):
    maps = RNG.uniform(0, 50, (3, *shape)).astype(np.float32)
    weights = RNG.uniform(0, 1, shape).astype(np.float32)
    weights[-1] = 0
    exact = [
        np.stack([solved_column(weights[:, x], strength, m[:, x]) for x in range(shape[1])], axis=1)
        for m in maps
    ]
    solve_columns(weights, strength, maps, np.empty(shape, np.float32))
    np.testing.assert_allclose(maps, exact, rtol=2e-4, atol=1e-3)


def test_whole_smoother_is_the_papers_where_nothing_slopes():
    guide = RNG.integers(0, 12, (20, 31, 3)).astype(np.uint8)
    values = np.where(RNG.uniform(size=(20, 31)) < 0.5, 10, 13).astype(np.float32)
    confidence = RNG.uniform(0.1, 1, values.shape).astype(np.float32)
    links = Links.of(guide, 4.0)
    value, support = links.smooth(np.stack([values * confidence, confidence]), strength=50.0)
    oracle = smoothed_oracle(values, confidence, guide, 50.0, 4.0)
    np.testing.assert_allclose(value / support, oracle, rtol=1e-4)


def test_links_are_by_colour():
    guide = np.zeros((2, 3, 3), np.uint8)
    guide[:, 2] = (3, 4, 0)
    links = Links.of(guide, 2.5)
    np.testing.assert_allclose(links.right[:2, 0], [1, np.exp(-5 / 2.5)], rtol=1e-6)
    np.testing.assert_array_equal(links.right[2], 0)
    np.testing.assert_allclose(links.down[0], 1)
    np.testing.assert_array_equal(links.down[1], 0)


def test_slopes_are_central_differences_of_known_neighbours_without_steps():
    y, x = np.mgrid[:9, :12].astype(np.float32)
    values, confidence = 0.25 * x - 0.5 * y + 20, np.full((9, 12), 0.5, np.float32)
    values[:, 7:] += 30
    confidence[4, 3] = 0
    out = np.empty((3, 9, 12), np.float32)
    weighed_slopes(values, confidence, 1.0, out)
    known = out[2] > 0
    np.testing.assert_allclose(out[0][known] / out[2][known], 0.25, rtol=1e-5)
    np.testing.assert_allclose(out[1][known] / out[2][known], -0.5, rtol=1e-5)
    assert not known[:, [0, 6, 7, 11]].any()  # border, and both sides of the step
    assert not known[[3, 4, 5, 4, 4], [3, 3, 3, 2, 4]].any()
    assert known[1:8, 1:6].sum() == 7 * 5 - 5


def test_a_slanted_plane_stays_and_its_noise_goes():
    """The bias that a smoother without slopes has here is 1 px."""
    y, x = np.mgrid[:60, :80].astype(np.float32)
    plane = 30 + 0.3 * y + 0.1 * x
    noisy = plane + RNG.normal(0, 0.3, plane.shape).astype(np.float32)
    guide = np.full((60, 80, 1), 90, np.uint8)
    confidence = np.ones_like(plane)
    (smooth,) = smooth_surfaces(noisy, confidence, guide, strength=500, sigma_color=1.5)
    inside = np.s_[6:-6, 6:-6]
    assert np.abs(smooth - plane)[inside].mean() < 0.35 * np.abs(noisy - plane)[inside].mean()
    flat = smoothed_oracle(noisy, confidence, guide, 500.0, 1.5)
    assert np.abs(flat - plane).mean() > 3 * np.abs(smooth - plane).mean()


def test_nothing_is_smoothed_across_an_edge_of_the_picture():
    values = np.full((30, 40), 10, np.float32)
    values[:, 20:] = 40
    guide = np.where(values > 20, 200, 50).astype(np.uint8)[:, :, None]
    (smooth,) = smooth_surfaces(values, np.ones_like(values), guide, strength=8000, sigma_color=1.5)
    np.testing.assert_allclose(smooth, values, atol=1e-3)


def scene(*, holes=0.2, seed=1):
    """A pair's frame with a noisy disparity map of two slanted surfaces, and its truth."""
    rng = np.random.default_rng(seed)
    height, width = 80, 128
    y, x = np.mgrid[:height, :width].astype(np.float32)
    near = (x > 50) & (x < 90) & (y > 20)
    truth = np.where(near, 40.0, 12 + 0.2 * y).astype(np.float32)
    grey = np.where(near, 170, 60) + rng.normal(0, 1, truth.shape)
    image = np.clip(grey, 0, 255).astype(np.uint8)
    sigma = rng.choice([0.2, 0.8], truth.shape).astype(np.float32)
    values = (truth + sigma * rng.normal(size=truth.shape)).astype(np.float32)
    hole = rng.uniform(size=truth.shape) < holes
    values[hole] = sigma[hole] = np.nan
    return frame(image, image), DisparityMap(values, sigma), truth


def test_errors_fall_and_sigma_still_holds_them():
    pair, measured, truth = scene()
    smooth, counts = Fgs().load()(pair, measured)
    valid = measured.valid
    np.testing.assert_array_equal(smooth.valid, valid)
    before, after = (np.abs(m.values - truth)[valid] for m in (measured, smooth))
    assert after.mean() < 0.7 * before.mean()
    assert np.mean(after < smooth.sigma[valid]) > 0.68
    assert (smooth.sigma[valid] >= measured.sigma[valid] * (1 - 1e-6)).all()
    assert 0.9 * valid.sum() < counts["pixels_smoothed"] <= valid.sum()
    assert counts["pixels_filled_by_smoothing"] == 0


def test_no_pixel_moves_by_more_than_its_sigma():
    pair, measured, _ = scene()
    values = measured.values.copy()
    values[40, 60] += 15  # an outlier that the smoother would pull away
    smooth, _ = Fgs().load()(pair, replace(measured, values=values))
    moved = np.abs(smooth.values - values)
    assert np.nanmax(moved / measured.sigma) <= 1 + 1e-4


def test_dense_gives_every_pixel_a_disparity_with_a_larger_sigma():
    pair, measured, truth = scene(holes=0.5)
    dense, counts = Fgs(dense=True).load()(pair, measured)
    assert dense.valid.all()
    hole = ~measured.valid
    assert counts["pixels_filled_by_smoothing"] == hole.sum()
    assert np.median(dense.sigma[hole]) > np.median(dense.sigma[~hole])
    assert np.mean(np.abs(dense.values - truth)[hole] < dense.sigma[hole]) > 0.68


def test_a_map_without_sigma_stays_without_and_an_empty_one_empty():
    pair, measured, _ = scene()
    smooth, _ = Fgs().load()(pair, DisparityMap(measured.values))
    assert smooth.sigma is None
    assert np.isfinite(smooth.values).sum() == measured.valid.sum()
    nothing = DisparityMap(np.full_like(measured.values, np.nan))
    assert not Fgs(dense=True).load()(pair, nothing)[0].valid.any()


def test_inputs_are_not_changed_and_results_repeat():
    pair, measured, _ = scene()
    before = measured.values.copy(), measured.sigma.copy()
    first, second = (Fgs(dense=True).load()(pair, measured)[0] for _ in range(2))
    np.testing.assert_array_equal(measured.values, before[0])
    np.testing.assert_array_equal(measured.sigma, before[1])
    assert first.values.tobytes() == second.values.tobytes()


@pytest.mark.parametrize(
    "settings", [{"strength": 0.0}, {"strength": np.inf}, {"sigma_color": -1.0}]
)
def test_settings_that_mean_nothing_are_refused(settings):
    with pytest.raises(StereoConfig, match="positive"):
        Fgs(**settings)
