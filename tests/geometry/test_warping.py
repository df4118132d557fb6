"""Pairs resampled as another one would see them, against the same by numpy and by projection."""

import numpy as np
import pytest

from pseudolidar.geometry.gaps import filled
from pseudolidar.geometry.projection import project
from pseudolidar.geometry.triangulation import points_by_q
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.geometry.warping import Warp
from pseudolidar.structures.correction import DisparityCorrection
from tests.moving_rig import rig

TWIST = np.array([0.1, -0.05, -1.2, 0.01, -0.02, 0.005])
COEFFICIENTS = np.array([-0.5, 0.6, 0.1, -0.2, 0.3, 0.05, -0.1, 0.2, 0.15, -0.25])
CORRECTION = DisparityCorrection(COEFFICIENTS, 0.1)


def disparities(of, *, gaps=True):
    """A road before a wall, with gaps in rows, at the border, and in whole rows."""
    width, height = of.left.size_px
    rows = np.arange(height, dtype=np.float32)[:, None]
    d = np.where(rows > 200, 4.0 + 0.25 * (rows - 200), 6.0) * np.ones((1, width), np.float32)
    d -= of.doffs_px
    if gaps:
        d[:, 100:140], d[50:60, :30], d[:3], d[300:303] = np.nan, np.nan, np.nan, np.nan
        d[np.random.default_rng(0).random(d.shape) < 0.1] = np.nan
    return d.astype(np.float32)


@pytest.mark.parametrize("correction", [None, CORRECTION])
@pytest.mark.parametrize("doffs_px", [0.0, 31.0])
def test_the_maps_are_those_of_points_that_move(doffs_px, correction):
    of = rig(doffs_px=doffs_px, fy_px=710.0)
    measured, T = disparities(of), exp_twist(TWIST)
    maps = Warp.by(measured, of, T, correction).maps
    v, u = (each.ravel().astype(np.float64) for each in np.indices(measured.shape))
    d = filled(measured).ravel().astype(np.float64)
    if correction is not None:
        d -= correction.offset_px(d, u, v, of.left.size_px)
    points = points_by_q(d, u, v, of) @ T[:3, :3].T + T[:3, 3]
    uv, _ = project(points, of.P_left)
    d_there = of.fB_px_m / points[:, 2] - doffs_px
    if correction is not None:
        d_there += correction.offset_px(d_there, *uv.T, of.left.size_px)
    # float32 pixels of a picture of 1242, and its products
    assert np.allclose(maps[0].ravel(), uv[:, 0], atol=2e-3)
    assert np.allclose(maps[1].ravel(), uv[:, 1], atol=2e-3)
    assert np.allclose(maps[2].ravel(), uv[:, 0] - d_there, atol=4e-3)


def test_without_disparities_all_is_infinitely_far():
    of = rig()
    nothing = np.full((375, 1242), np.nan, np.float32)
    shift = np.array([0.5, 0, 1.0, 0, 0, 0])
    maps = Warp.by(nothing, of, exp_twist(shift)).maps
    assert np.allclose(maps[0], np.arange(1242), atol=1e-3)
    assert np.allclose(maps[1], np.arange(375)[:, None], atol=1e-3)


def test_a_picture_is_seen_from_where_it_was():
    of = rig()
    picture = np.random.default_rng(1).integers(0, 256, (375, 1242), np.uint8)
    warp = Warp.by(disparities(of, gaps=False), of, np.eye(4))
    assert np.array_equal(warp.left(picture)[:, 1:-1], picture[:, 1:-1])
    at = warp.at(np.array([[600.25, 100.5]], np.float32))
    assert np.allclose(at, [[600.25, 100.5, 594.25]], atol=0.05)  # steps of 1/32 px
    assert warp.at(np.zeros((0, 2), np.float32)).shape == (0, 3)
