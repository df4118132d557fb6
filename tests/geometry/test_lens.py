import numpy as np
import pytest

from pseudolidar.geometry.lens import Lens
from pseudolidar.structures.camera import Camera
from tests.raw_rigs import FISHEYE, PINHOLE, seen_at

K = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])


def pinhole(D: np.ndarray) -> Camera:
    return Camera(K, 640, 480, np.asarray(D, float))


def fisheye(D: np.ndarray) -> Camera:
    return Camera(K, 640, 480, np.asarray(D, float), "fisheye")


@pytest.mark.parametrize("coefficients", [0, 4, 5, 8, 12, 14])
def test_pinhole_lenses_are_opencvs_and_go_back(coefficients: int):
    camera = pinhole(PINHOLE[:coefficients])
    lens = Lens.of(camera)
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (500, 3))
    points[:, 2] = 1.0
    uv, holds = lens.pixels(points)
    assert holds.all()
    np.testing.assert_allclose(uv, seen_at(camera, points), atol=1e-9)
    back = lens.directions(uv)
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], points[:, :2], atol=1e-9)


@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_fisheyes_are_opencvs_and_go_back(strength: float):
    camera = fisheye(strength * FISHEYE)
    lens = Lens.of(camera)
    rng = np.random.default_rng(1)
    angle, around = rng.uniform(0, np.deg2rad(89), 500), rng.uniform(-np.pi, np.pi, 500)
    directions = np.stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=-1
    )
    uv, holds = lens.pixels(3.0 * directions)
    assert holds.all()
    np.testing.assert_allclose(uv, seen_at(camera, directions), atol=1e-9)
    np.testing.assert_allclose(lens.directions(uv), directions, atol=1e-9)


def test_a_fisheye_sees_behind_itself():
    lens = Lens.of(fisheye(np.zeros(4)))
    angle = np.deg2rad(105.0)
    uv, holds = lens.pixels(np.array([[np.sin(angle), 0.0, np.cos(angle)]]))
    assert holds.all()
    assert uv[0, 0] == pytest.approx(320 + 500 * angle)


def test_directions_beyond_the_turning_point_of_the_polynomial_are_seen_nowhere():
    """r (1 - 0.3 r^2) is largest at r = 1.054; OpenCV folds what is further out back in."""
    camera = pinhole([-0.3, 0, 0, 0, 0])
    lens = Lens.of(camera)
    assert np.tan(lens.limit_rad) == pytest.approx(1 / np.sqrt(0.9), rel=2e-3)
    far = np.array([[1.6, 0.0, 1.0]])
    assert 0 < seen_at(camera, far)[0, 0] < 640
    uv, holds = lens.pixels(far)
    assert not holds.any()
    assert np.isnan(uv).all()


def test_nothing_is_seen_behind_a_pinhole_or_in_its_plane():
    _, holds = Lens.of(pinhole([])).pixels(np.array([[0.1, 0, -1.0], [1.0, 0, 0.0], [0, 0, 0.5]]))
    assert holds.tolist() == [False, False, True]


def test_dark_corners_have_no_direction_and_a_nearest_one():
    lens = Lens.of(fisheye([0.0, 0.0, 0.0, -0.05]))
    corner = np.array([[5000.0, 240.0]])
    assert np.isnan(lens.directions(corner)).all()
    nearest = lens.nearest_directions(corner)[0]
    np.testing.assert_allclose(
        nearest, [np.sin(lens.limit_rad), 0.0, np.cos(lens.limit_rad)], atol=1e-12
    )
