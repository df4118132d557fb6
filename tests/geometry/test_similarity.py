"""Points laid onto points: the motion that was put in comes out, and open turns are said."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.similarity import similarity_of, turn_sigma_rad
from pseudolidar.geometry.twists import exp_twist

T = exp_twist(np.array([5.0, -2.0, 1.0, 0.4, -1.9, 0.7]))


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_motion_and_scale_come_back(scale):
    src = np.random.default_rng(3).normal(size=(50, 3)) * (20, 10, 0.01)
    dst = scale * src @ T[:3, :3].T + T[:3, 3]
    found = similarity_of(src, dst, scaled=True)
    assert found.determined
    assert found.scale == pytest.approx(scale, rel=1e-12)
    np.testing.assert_allclose(found.R, T[:3, :3], atol=1e-9)
    np.testing.assert_allclose(found.t_m, T[:3, 3], atol=1e-9)


def test_a_mirror_image_gets_a_rotation_not_a_mirror():
    src = np.random.default_rng(4).normal(size=(50, 3))
    found = similarity_of(src, src * (1, 1, -1), scaled=False)
    assert np.linalg.det(found.R) == pytest.approx(1)
    assert found.scale == 1.0


def test_points_on_a_line_leave_a_turn_open():
    line = np.outer(np.arange(10.0), (1.0, 2.0, 0.5))
    found = similarity_of(line, line @ T[:3, :3].T, scaled=False)
    assert not found.determined
    np.testing.assert_allclose(line @ found.R.T + found.t_m, line @ T[:3, :3].T, atol=1e-9)
    assert not similarity_of(np.ones((5, 3)), np.ones((5, 3)), scaled=True).determined


def test_points_near_a_line_hold_the_turn_about_it_by_how_far_they_are_from_it():
    sides = np.tile([1.0, -1.0, -1.0, 1.0], 5)
    laid = np.column_stack([np.arange(20.0), 0.1 * sides, np.zeros(20)])
    laid = laid @ T[:3, :3].T + T[:3, 3]
    off = np.column_stack([np.full(20, 0.3), np.zeros(20), 0.02 * np.tile([1.0, -1.0], 10)])
    dst = laid + off @ T[:3, :3].T  # what is off along the line turns nothing
    assert turn_sigma_rad(laid, dst) == pytest.approx(0.2 / np.sqrt(2), rel=1e-3)
    line = np.outer(np.arange(4.0), (1.0, 0.0, 0.0))
    assert turn_sigma_rad(line, line) == np.inf
