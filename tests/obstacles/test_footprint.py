"""The rectangle seen from above: found from its near side, with an error that it has."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.obstacles.class_sizes import CAR, ClassSize
from pseudolidar.obstacles.contour import Contour
from pseudolidar.obstacles.footprint import Edges, Footprint, fitted

FB_PX_M, FOCAL_PX = 384.0, 721.5


def corners_of(x: float, z: float, heading: float, length: float, width: float) -> np.ndarray:
    s, c = np.sin(heading), np.cos(heading)
    local = 0.5 * np.array([[length, width], [length, -width], [-length, -width], [-length, width]])
    return local @ np.array([[s, c], [c, -s]]) + [x, z]


def near_side(corners: np.ndarray, bearing: np.ndarray) -> np.ndarray:
    """Z at which each line of sight first meets one of the four sides."""
    depths = np.full(len(bearing), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        across = (a[0] - b[0]) - bearing * (a[1] - b[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (a[0] - bearing * a[1]) / across
        hit = (share >= 0) & (share <= 1)
        depths = np.where(hit, np.minimum(depths, a[1] + share * (b[1] - a[1])), depths)
    return depths


def seen(values: tuple[float, ...], rng=None, size: ClassSize = CAR) -> Footprint:
    """The rectangle that is found of one that is seen as a stereo rig sees it."""
    corners = corners_of(*values)
    edges = corners[:, 0] / corners[:, 1]
    bearing = np.linspace(edges.min(), edges.max(), 42)[1:-1]
    depth = near_side(corners, bearing)
    sigma = 0.2 * depth**2 / FB_PX_M
    if rng is not None:
        # neighbours share their errors, by fours
        depth = depth + sigma * np.repeat(rng.standard_normal(10), 4)
    contour = Contour(bearing, depth, np.hypot(sigma, 0.02), independent=10.0)
    found = Edges(float(edges.min()), float(edges.max()), 1.0 / FOCAL_PX)
    return fitted(contour, found, size, float(depth.min()))


@pytest.mark.parametrize("heading_deg", [0, 20, 45, 70, 90, 130, 165])
@pytest.mark.parametrize("x", [-4.0, 0.5, 6.0])
def test_a_car_of_the_usual_size_is_found_where_it_stands(heading_deg: float, x: float) -> None:
    truth = (x, 14.0, np.radians(heading_deg), CAR.length_m[0], CAR.width_m[0])
    found = seen(truth)
    assert found.nearest_m == pytest.approx(corners_of(*truth)[:, 1].min(), abs=0.05)
    off = np.degrees(found.values[2]) - heading_deg
    assert abs((off + 90) % 180 - 90) < 3
    np.testing.assert_allclose(found.values[:2], truth[:2], atol=0.1)


def test_one_side_alone_takes_the_length_of_its_class_and_says_so() -> None:
    found = seen((0.0, 20.0, 0.0, 4.8, 1.65))
    assert found.values[3] == pytest.approx(CAR.length_m[0], abs=0.1)
    assert np.sqrt(found.covariance[3, 3]) == pytest.approx(CAR.length_m[1], rel=0.1)
    assert np.sqrt(found.covariance[4, 4]) < 0.5 * CAR.width_m[1]


def test_the_error_of_the_nearest_face_is_the_one_that_is_told() -> None:
    rng = np.random.default_rng(5)
    truth = (2.0, 25.0, np.radians(25), 3.9, 1.65)
    near = corners_of(*truth)[:, 1].min()
    found = [seen(truth, rng) for _ in range(60)]
    off = np.array([(one.nearest_m - near) / one.sigma_nearest_m for one in found])
    assert 0.5 < np.mean(np.abs(off) < 1) < 0.9
    assert np.mean(np.abs(off) < 3) > 0.95
