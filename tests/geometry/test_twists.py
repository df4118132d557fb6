import numpy as np
import pytest

from pseudolidar.geometry.twists import exp_twist, skew


@pytest.mark.parametrize("size", [1e-9, 1e-5, 0.1, 2.0])
def test_the_exponential_is_the_limit_of_small_steps(size):
    twist = size * np.array([1.0, -2.0, 0.5, 0.3, -0.2, 0.9])
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = skew(twist[3:]), twist[:3]
    steps = 2**20
    many = np.linalg.matrix_power(np.eye(4) + generator / steps, steps)
    assert np.allclose(exp_twist(twist), many, atol=1e-5 * size)


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(1).normal(size=(2, 7, 3))
    assert np.allclose(np.einsum("nij,nj->ni", skew(a), b), np.cross(a, b))
