import numpy as np
import pytest

from pseudolidar.geometry.twists import adjoint, exp_twist, inverted, log_twist, skew


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


@pytest.mark.parametrize("size", [1e-9, 1e-5, 0.1, 1.0])
def test_the_logarithm_turns_the_exponential_round(size):
    twist = size * np.array([1.0, -2.0, 0.5, 0.3, -0.2, 0.9])
    assert np.allclose(log_twist(exp_twist(twist)), twist, rtol=1e-7, atol=1e-15)


def test_twists_are_carried_to_the_other_side():
    T, twist = exp_twist(np.array([1.0, -2.0, 0.5, 0.3, -0.2, 0.9])), 0.1 * np.arange(1.0, 7.0)
    assert np.allclose(exp_twist(adjoint(T) @ twist) @ T, T @ exp_twist(twist))
    assert np.allclose(inverted(T) @ T, np.eye(4))
