import cv2
import numpy as np
import pytest

from pseudolidar.calibration.solving.lens_terms import COEFFICIENTS, camera_of, parameters, project
from pseudolidar.geometry.lens import Lens

POINTS = np.random.default_rng(0).normal(size=(40, 3)) * 0.4 + [0, 0, 1.5]
STEP = 1e-6


def vector(model: str) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.concatenate([[300, 310, 320, 240], rng.normal(size=COEFFICIENTS[model]) * 0.02])


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_pixels_are_opencvs(model):
    v = vector(model)
    K = np.array([[v[0], 0, v[2]], [0, v[1], v[3]], [0, 0, 1]])
    library = cv2.fisheye if model == "fisheye" else cv2
    wanted = library.projectPoints(POINTS[:, None], np.zeros(3), np.zeros(3), K, v[4:])[0][:, 0]
    np.testing.assert_allclose(project(model, v, POINTS)[0], wanted, atol=1e-9)


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_derivatives_are_those_of_small_steps(model):
    v = vector(model)
    _, by_point, by_vector = project(model, v, POINTS)

    def slope(change, at) -> np.ndarray:
        ends = [project(model, *at(sign * STEP * change))[0] for sign in (1, -1)]
        return (ends[0] - ends[1]) / (2 * STEP)

    points = np.stack([slope(e, lambda d: (v, POINTS + d)) for e in np.eye(3)], axis=-1)
    vectors = [slope(e, lambda d: (v + d, POINTS)) for e in np.eye(parameters(model))]
    np.testing.assert_allclose(by_point, points, atol=1e-6)
    np.testing.assert_allclose(by_vector, np.stack(vectors, axis=-1), atol=1e-6)


def test_a_fisheye_has_derivatives_on_its_axis_and_beyond_90_degrees():
    v = np.array([300, 310, 320, 240, 0.01, 0.01, 0.0, 0.0])
    points = np.array([[0.0, 0.0, 1.0], [1.0, 0.2, -0.3]])
    uv, by_point, by_vector = project("fisheye", v, points)
    assert np.isfinite(by_point).all()
    assert np.isfinite(by_vector).all()
    np.testing.assert_allclose(uv[0], [320, 240])
    wanted, _ = Lens.of(camera_of("fisheye", v, (640, 480), "camera_left")).pixels(points)
    np.testing.assert_allclose(uv, wanted, atol=1e-9)
