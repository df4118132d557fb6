"""Planes through points of which some are wrong."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.plane_fit import fit_plane, principal
from pseudolidar.geometry.quaternion import rotation_of

NOISE = 0.02
TURN = rotation_of(np.array([0.8, 0.3, -0.2, 0.48]) / np.linalg.norm([0.8, 0.3, -0.2, 0.48]))
FAR = np.array([4.5e5, 5.4e6, 100.0])


def wall(count: int = 4000, noise: float = NOISE, seed: int = 0) -> np.ndarray:
    """4 m x 3 m at right angles to z, before it is turned."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform((-2, -1.5, 0), (2, 1.5, 0), (count, 3))
    flat[:, 2] = rng.normal(0, noise, count) if noise else 0
    return flat


def test_a_plane_with_known_noise_in_any_pose():
    plane = fit_plane(wall() @ TURN.T + FAR)
    assert plane is not None
    assert abs(plane.normal @ TURN[:, 2]) == pytest.approx(1, abs=1e-6)
    assert np.abs((plane.middle - FAR) @ TURN[:, 2]) < 3 * NOISE / np.sqrt(4000)
    rms = np.sqrt(np.mean(plane.distances[plane.on] ** 2))
    assert rms == pytest.approx(NOISE, rel=0.04)
    assert plane.on.mean() == pytest.approx(0.9973, abs=0.003)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.45])
def test_things_before_a_wall_do_not_tilt_it(share: float):
    """A heap to one side and all before it: least squares alone would be degrees off."""
    points, rng = wall(), np.random.default_rng(1)
    wrong = int(share * len(points))
    points[:wrong] = rng.uniform((1, -1.5, 0.3), (2, 1.5, 2), (wrong, 3))
    plane = fit_plane(points)
    assert plane is not None
    assert np.degrees(np.arccos(abs(plane.normal[2]))) < 0.1
    assert plane.on[:wrong].mean() < 0.02
    assert plane.on[wrong:].mean() > 0.98
    _, axes, _ = principal(points)
    assert np.degrees(np.arccos(abs(axes[2, 2]))) > 5


@pytest.mark.parametrize(("share", "sigmas"), [(0.2, 5), (0.3, 6), (0.4, 7), (0.45, 10)])
def test_kerbs_do_not_tilt_the_road(share: float, sigmas: float):
    """A step of some sigma at one side, which lies within the spread that all points have."""
    rng = np.random.default_rng(0)
    road = rng.uniform((-1, -1, 0), (1, 1, 0), (3000, 3))
    road[:, 2] = rng.normal(0, NOISE, 3000)
    kerb = road[:, 0] > 1 - 2 * share
    road[kerb, 2] += sigmas * NOISE
    plane = fit_plane(road)
    assert plane is not None
    # So far the noise of the rest alone tilts it: three times 0.02 m / (0.3 m * sqrt(1650)).
    assert np.degrees(np.arccos(abs(plane.normal[2]))) < 0.3
    assert plane.on[kerb].mean() < 0.04
    assert np.sqrt(np.mean(plane.distances[plane.on] ** 2)) == pytest.approx(NOISE, rel=0.04)


@pytest.mark.parametrize("count", [10, 20, 50])
def test_few_points_of_a_clean_plane_are_on_it(count: int):
    planes = [fit_plane(wall(count, seed=seed)) for seed in range(20)]
    assert np.mean([plane.on.mean() for plane in planes if plane is not None]) > 0.96


def test_exact_planes_have_all_their_points():
    for noise, kind in ((0.0, np.float64), (0.0, np.float32)):
        points = (wall(500, noise) @ TURN.T + (20, 3, -1)).astype(kind)
        plane = fit_plane(points)
        assert plane is not None
        assert plane.on.all()
        assert np.abs(plane.distances).max() < (1e-12 if kind is np.float64 else 4e-6)
    plane = fit_plane(np.array([(0, 0, 1), (3, 0, 1), (0, 4, 1.0)]))
    assert plane is not None
    assert np.abs(plane.normal) == pytest.approx((0, 0, 1))


def test_axes_of_a_plane_are_those_of_the_points_on_it():
    plane = fit_plane(wall() @ TURN.T + FAR)
    assert plane is not None
    assert np.abs(np.diag(plane.axes.T @ TURN)).min() > 0.99


def test_what_tells_no_plane_is_none():
    line = np.linspace(0, 5, 40)[:, None] * TURN[:, 0] + FAR
    for points in (line[:0], line[:1], line[:2], line, np.repeat(line[:1], 9, axis=0)):
        assert fit_plane(points) is None


def test_own_axes_are_those_of_the_shape():
    middle, axes, lengths = principal(wall() @ TURN.T + FAR)
    assert np.allclose(middle, FAR, atol=0.1)
    assert np.abs(np.diag(axes.T @ TURN)).min() > 0.99
    assert lengths == pytest.approx((4 / 12**0.5, 3 / 12**0.5, NOISE), rel=0.05)
