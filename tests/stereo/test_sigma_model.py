"""The model of sigma: fitted to errors whose spread is known."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import StructureError
from pseudolidar.stereo.sigma_model import FEATURES, SigmaModel, fit_sigma

KNOWN = SigmaModel(
    constant=-1.0,
    linear=(-1.5, 0.0, 0.6, 0.4, -0.2),
    quadratic=(0.0, 0.5, 0.0, 0.05, 0.0),
    low=(0.0, 0.0, 0.0, -5.0, -6.0),
    high=(1.0, 1.0, 7.0, 1.0, 6.0),
)


def samples(n: int, *, seed: int, heavy: bool = True) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    features = rng.uniform(KNOWN.low, KNOWN.high, (n, len(FEATURES)))
    noise = rng.standard_t(3, n) if heavy else rng.normal(size=n)
    # Scaled so that 68.27 % lie within 1: the quantile of Student's t with 3 degrees is 1.197.
    return features, KNOWN.sigma_px(features) * (noise / 1.197 if heavy else noise)


@pytest.mark.parametrize("heavy", [True, False])
def test_a_known_model_is_found_again(heavy):
    model = fit_sigma(*samples(40_000, seed=1, heavy=heavy))
    features, errors = samples(20_000, seed=2, heavy=heavy)
    ratio = model.sigma_px(features) / KNOWN.sigma_px(features)
    assert np.quantile(ratio, 0.05) > 0.93
    assert np.quantile(ratio, 0.95) < 1.07
    within = np.mean(np.abs(errors) < model.sigma_px(features))
    assert within == pytest.approx(0.6827, abs=0.012)


def test_features_beyond_the_fitted_range_count_as_its_end():
    beyond = np.array([[2.0, 2.0, 9.0, 3.0, 9.0]])
    assert KNOWN.sigma_px(beyond) == KNOWN.sigma_px(np.array([KNOWN.high]))


def test_the_kernels_array_says_the_same():
    low, high, linear, quadratic, constant = KNOWN.as_array().astype(np.float64)
    features, _ = samples(100, seed=4)
    f = np.clip(features, low, high)
    sigma = np.exp2(constant[0] + f @ linear + f * f @ quadratic)
    np.testing.assert_allclose(sigma, KNOWN.sigma_px(features), rtol=1e-5)


def test_few_samples_are_refused():
    with pytest.raises(StructureError, match="999 samples; wanted at least 1000"):
        fit_sigma(*samples(999, seed=0))
