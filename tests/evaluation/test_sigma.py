import numpy as np
import pytest

from pseudolidar.evaluation.sigma import (
    fit_scale,
    sigma_shares,
    sigma_shares_by_range,
    sparsification_curve,
    sparsification_error,
    total_sigma,
)

N = 50_000
RNG = np.random.default_rng(9)
SIGMA_PX = RNG.uniform(0.1, 2.0, N)
ERROR_PX = RNG.normal(0, SIGMA_PX)


def test_shares_of_normal_errors():
    shares = sigma_shares(ERROR_PX, SIGMA_PX)
    assert shares.n == N
    assert shares.within_1_sigma == pytest.approx(0.6827, abs=0.01)
    assert shares.within_95 == pytest.approx(0.9949, abs=0.002)  # 2.8 sigma of a normal one
    assert sigma_shares(ERROR_PX[:0], SIGMA_PX[:0]).within_1_sigma is None


def test_the_fitted_scale_holds_68_percent_with_the_systematic_error():
    measured = ERROR_PX + RNG.normal(0, 0.3)
    for wrong in (0.2, 1.0, 3.0):
        scale = fit_scale(measured, wrong * SIGMA_PX, 0.15)
        total = total_sigma(wrong * SIGMA_PX, 0.15, scale=scale)
        assert sigma_shares(measured, total).within_1_sigma == pytest.approx(0.6827, abs=1e-3)


def test_shares_by_range():
    depth_m = np.where(np.arange(N) % 2, 7.0, 60.0)
    sigma_px = np.where(depth_m > 50, 0.5 * SIGMA_PX, SIGMA_PX)
    rows = sigma_shares_by_range(ERROR_PX, sigma_px, depth_m)
    assert [row["n"] for row in rows] == [N // 2, 0, 0, 0, N // 2]
    assert rows[0]["within_1_sigma"] == pytest.approx(0.6827, abs=0.01)
    assert rows[1]["within_1_sigma"] is None
    assert rows[4]["within_1_sigma"] == pytest.approx(0.3829, abs=0.01)


def test_sparsification():
    assert sparsification_error(ERROR_PX, np.abs(ERROR_PX)) == pytest.approx(0.0, abs=1e-12)
    informed = sparsification_error(ERROR_PX, SIGMA_PX)
    blind = sparsification_error(ERROR_PX, RNG.permutation(SIGMA_PX))
    assert 0.0 < informed < 0.7 * blind
    assert sparsification_error(ERROR_PX[:0], SIGMA_PX[:0]) is None


def test_the_sparsification_curve_ends_with_the_surest():
    error = np.linspace(1, 20, 20)
    curve = sparsification_curve(error, error[::-1].copy())  # the wrong way round
    assert curve.kept[[0, -1]] == pytest.approx([1.0, 0.05])
    assert curve.by_sigma[[0, -1]] == pytest.approx([1.0, 20 / error.mean()])
    assert curve.by_error[[0, -1]] == pytest.approx([1.0, 1 / error.mean()])
    assert curve.as_dict()["ause"] == sparsification_error(error, error[::-1].copy()) > 0
