"""The kernels of the ground against the same in numpy, bit for bit where they decide."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.clouds.ground_kernels import low_points, misfits, points_on_plane
from pseudolidar.geometry.planes import Plane
from pseudolidar.structures.pose import Pose

ORIGIN = np.array([0.3, 0.1, 0.2])


def some_points(kind: type) -> tuple[np.ndarray, Pose]:
    rng = np.random.default_rng(6)
    xyz = rng.uniform((-20, -20, -3), (40, 20, 2), (5000, 3)).astype(kind)
    xyz[::7] = np.nan
    a = 0.1
    R = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    return xyz, Pose.from_rotation("velodyne", "camera_left", R, np.array([0.2, 0.1, -0.3]))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("most", [500, 100_000])
def test_low_points_are_those_of_the_whole_cloud_turned(kind: type, most: int) -> None:
    xyz, T = some_points(kind)
    index, low = low_points(xyz, T.matrix[:3].astype(kind), ORIGIN, 0.3, 2.0, 35.0, most)
    turned = T.apply(xyz)
    want = np.flatnonzero(turned[:, 2] < ORIGIN[2] - 0.3)
    want = want[:: max(1, len(want) // most)]
    away = np.hypot(*(turned[want, :2] - ORIGIN[:2]).T)
    want = want[(away > 2) & (away < 35)]
    np.testing.assert_array_equal(index, want)
    np.testing.assert_array_equal(low, turned[want])
    assert len(low) > 100


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("told", [True, False])
def test_points_on_a_plane_are_those_of_the_whole_cloud_turned(kind: type, told: bool) -> None:
    xyz, T = some_points(kind)
    plane = Plane.of("velodyne", np.array([0.02, -0.01, 1.0]), 1.2)
    sigma = np.linspace(0.01, 4, len(xyz)).astype(np.float32) if told else np.empty(0, np.float32)
    above_m = float(plane.heights_m(ORIGIN[None])[0])
    equation = np.array([*plane.normal, plane.offset_m]).astype(kind)
    pose, origin = T.matrix[:3].astype(kind), ORIGIN.astype(kind)
    found = points_on_plane(xyz, sigma, pose, equation, origin, above_m, 0.15)
    turned = T.apply(xyz)
    heights = np.abs(plane.heights_m(turned))
    want = heights <= 0.15
    if told:
        away = turned - origin
        across = sigma * above_m / np.sqrt((away * away).sum(axis=1))
        want = (heights <= np.minimum(0.3, np.maximum(0.15, 2 * across))) & np.isfinite(across)
    np.testing.assert_array_equal(found, want)
    assert found.any()
    assert not found.all()


def test_misfits_are_truncated_and_what_lies_below_counts_more() -> None:
    rng = np.random.default_rng(8)
    points, sigma = rng.uniform(-5, 5, (300, 3)), rng.uniform(0.1, 2, 300)
    planes = rng.normal(0, 1, (20, 3))
    found = misfits(planes, points, sigma, 3.0, 2.0)
    a, b, c = planes.T[:, :, None]
    ratio = (points[:, 2] - a * points[:, 0] - b * points[:, 1] - c) / sigma
    loss = np.minimum(ratio**2, 9.0) * np.where(ratio < -3, 2.0, 1.0)
    np.testing.assert_allclose(found, loss.sum(axis=1), rtol=1e-12)
