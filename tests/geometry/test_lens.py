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


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
def test_a_skewed_camera_is_the_straight_one_with_its_rows_shifted(model: str):
    """With skew s a pixel lies s (v - cy) / fy further right than without."""
    skewed = K.copy()
    skewed[0, 1] = 30.0
    D = PINHOLE[:5] if model == "pinhole" else FISHEYE
    straight, lens = (Lens.of(Camera(each, 640, 480, D, model)) for each in (K, skewed))
    points = np.random.default_rng(2).uniform(-0.6, 0.6, (100, 3))
    points[:, 2] = 1.0
    wanted = straight.pixels(points)[0]
    wanted[:, 0] += 30.0 * (wanted[:, 1] - 240) / 510
    uv, _ = lens.pixels(points)
    np.testing.assert_allclose(uv, wanted, atol=1e-9)
    back = lens.directions(uv)
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], points[:, :2], atol=1e-9)


def test_the_nearest_direction_of_a_dark_corner_lies_towards_it_with_skew_too():
    skewed = K.copy()
    skewed[0, 1] = 200.0
    lens = Lens.of(Camera(skewed, 640, 480, np.array([0.0, 0.0, 0.0, -0.05]), "fisheye"))
    down = np.array([[320.0 + 200 * 9.0, 240.0 + 510 * 9.0]])  # 9 focal lengths below the centre
    assert np.isnan(lens.directions(down)).all()
    np.testing.assert_allclose(
        lens.nearest_directions(down)[0],
        [0.0, np.sin(lens.limit_rad), np.cos(lens.limit_rad)],
        atol=1e-12,
    )


def test_a_dark_corner_of_a_pinhole_lens_is_taken_from_the_edge_on_its_side():
    lens = Lens.of(pinhole([-0.3, 0, 0, 0, 0]))
    corners = np.array([[-400.0, -300.0], [1040.0, -300.0], [-400.0, 780.0], [1040.0, 780.0]])
    assert np.isnan(lens.directions(corners)).all()
    nearest = lens.nearest_directions(corners)
    towards = (corners - [320, 240]) / [500, 510]
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    np.testing.assert_allclose(nearest[:, 2], np.cos(lens.limit_rad), atol=1e-12)
    np.testing.assert_allclose(nearest[:, :2], np.sin(lens.limit_rad) * towards, atol=1e-12)


@pytest.mark.parametrize(
    "camera",
    [pinhole([-0.3, 0, 0, 0, 0]), pinhole([-0.3, 0, 0.1, 0, 0]), fisheye([0.0, 0.0, 0.0, -0.2])],
    ids=("pinhole", "decentred", "fisheye"),
)
def test_a_direction_is_one_that_is_seen_at_its_pixel_or_none(camera: Camera):
    """A decentred lens shows less on one side than its radial part alone would."""
    lens = Lens.of(camera)
    u, v = np.meshgrid(np.linspace(-300, 940, 60), np.linspace(-400, 880, 60))
    uv = np.stack([u, v], axis=-1).reshape(-1, 2)
    directions = lens.directions(uv)
    found = np.isfinite(directions).all(axis=1)
    assert 0.1 < found.mean() < 0.9
    seen, holds = lens.pixels(directions[found])
    assert holds.all()
    np.testing.assert_allclose(seen, uv[found], atol=1e-3)


@pytest.mark.parametrize("turn", [(0.03, 0.0), (0.0, -0.02)])
def test_a_sensor_that_is_turned_about_one_axis(turn: tuple[float, float]) -> None:
    camera = pinhole(np.array([*PINHOLE[:12], *turn]))
    points = np.array([[0.3, -0.2, 1.0], [-0.4, 0.1, 1.2]])
    seen, holds = Lens.of(camera).pixels(points)
    assert holds.all()
    np.testing.assert_allclose(seen, seen_at(camera, points), atol=1e-9)
