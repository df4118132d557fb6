from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.calibration.rows import RowPoints, fit_rows, row_points
from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.geometry.tracking import MatchedPair
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.structures.correction import RowCorrection

SIZE_PX = (1242, 375)
PLANTED = np.array([0.1, 0.3, -0.15, -0.2, 1.2, 0.1, -0.2, 0.3, -0.25])


def points(*, frames=6, each=400, planted=PLANTED, noise_px=0.1, outliers=0.1, span=(0.0, 1.0)):
    rng = np.random.default_rng(4)
    for _ in range(frames):
        u, v = rng.uniform(span[0], span[1], each) * 1241, rng.uniform(0, 374, each)
        lower = RowCorrection(planted, 0.0).offset_px(u, v, SIZE_PX) + rng.normal(0, noise_px, each)
        wrong = rng.random(each) < outliers
        lower[wrong] += rng.uniform(1, 4, wrong.sum())
        yield RowPoints(u, v, lower, SIZE_PX)


def test_planted_rows_are_found_among_outliers():
    fit = fit_rows(list(points()), origin="planted")
    u, v = np.meshgrid(np.linspace(0, 1241, 30), np.linspace(0, 374, 10))
    found = fit.correction.offset_px(u, v, SIZE_PX)
    planted = RowCorrection(PLANTED, 0.0).offset_px(u, v, SIZE_PX)
    # one-sided outliers pull by 0.02 px; the rest is noise at the corners
    assert np.abs(found - planted).max() < 0.1
    assert fit.correction.origin.startswith("planted: rows ")
    assert fit.before_px > 0.4
    assert fit.after_px == pytest.approx(0.12, abs=0.03)  # noise, and the outliers among 68 %
    assert fit.correction.residual_px == fit.after_px
    assert "judged on frames left out" in fit.line


def test_sound_rows_stay():
    fit = fit_rows(list(points(planted=np.zeros(9))))
    assert fit.correction is None
    assert "nothing to be gained" in fit.line


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"frames": 2}, "too few"),
        ({"each": 30}, "too few"),
        ({"span": (0.0, 0.5)}, "cover only 50%"),
    ],
)
def test_what_cannot_be_fitted_is_said(options, reason):
    fit = fit_rows(list(points(**options)))
    assert fit.correction is None
    assert reason in fit.line
    assert fit.as_dict()["corrected"] is False


def test_rows_of_pictures_are_found_and_density_comes_back():
    """Right pictures of a street, tilted: matches tell by how much, and resampling mends it."""
    source = Synthetic("street", frames=4, seed=2, width_px=620).open()
    tilt = RowCorrection(np.array([0, 0, 0, 0, -1.6, 0, 0, 0, 0.0]), 0.0)
    sound = [source.load(i) for i in range(4)]
    frames = [replace(frame, right=rows_aligned(frame.right, tilt)) for frame in sound]
    match = Census().load()
    fit = fit_rows([row_points(MatchedPair.of(frame, match(frame))) for frame in frames])
    assert fit.correction.coefficients[4] == pytest.approx(1.6, abs=0.15)
    mended = [replace(f, right=rows_aligned(f.right, fit.correction)) for f in frames]
    valid = [
        np.mean([match(frame).valid.mean() for frame in each]) for each in (sound, frames, mended)
    ]
    assert valid[1] < valid[0] - 0.02
    assert valid[2] > valid[0] - 0.01
