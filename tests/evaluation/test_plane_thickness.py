"""Thickness of planes whose points are scattered by a known length."""

import numpy as np
import pytest

from pseudolidar.evaluation.plane_thickness import plane_thickness

FRAMES = 6


def plane(rng: np.random.Generator, across: int, sigma_m: float, n: int = 20_000) -> np.ndarray:
    """Points of 4 x 4 m in the middle of cubes, scattered along one axis."""
    xyz = rng.uniform(0, 4, (n, 3))
    xyz[:, across] = 0.2 + rng.normal(0, sigma_m, n)
    return xyz


@pytest.mark.parametrize(("across", "ground"), [(2, True), (0, False), (1, False)])
def test_is_the_scatter_across_the_plane(across, ground):
    rng = np.random.default_rng(across)
    xyz = plane(rng, across, 0.02)
    planes = plane_thickness(xyz, rng.integers(FRAMES, size=len(xyz)))
    assert planes.median_m(ground=ground) == pytest.approx(0.02, rel=0.03)
    assert planes.count(ground=ground) == 100
    assert planes.count(ground=not ground) == 0
    assert np.isnan(planes.median_m(ground=not ground))


def test_cubes_that_few_frames_see_or_that_hold_no_plane_are_not_judged():
    rng = np.random.default_rng(7)
    xyz = plane(rng, 2, 0.02)
    assert plane_thickness(xyz, rng.integers(3, size=len(xyz))).count(ground=True) == 0
    line = rng.normal(0, 0.01, (4000, 3)) + 0.2
    line[:, 0] = rng.uniform(0, 0.4, len(line))
    assert len(plane_thickness(line, rng.integers(FRAMES, size=len(line))).ground) == 0


def test_no_points_no_planes():
    planes = plane_thickness(np.empty((0, 3)), np.empty(0, np.int64))
    assert planes.count(ground=True) == 0
