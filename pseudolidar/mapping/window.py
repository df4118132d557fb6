"""The last keyframes together: motions between neighbours, and across them, made to agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.twists import adjoint, exp_twist, inverted, log_twist
from pseudolidar.structures.arrays import Float64

# Beyond so many standard deviations a motion across counts little: one of the two is wrong.
KERNEL_SIGMA = 5.0
ITERATIONS, CONVERGED = 10, 1e-9
# Holds the first pose where it is.
FIXED = 1e12


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured motion between two keyframes.

    Args:
        first: number of the earlier one.
        second: of the later one.
        T_first_second: (4, 4) pose of the later one in the earlier one.
        covariance: (6, 6) of a twist on its right.
    """

    first: int
    second: int
    T_first_second: Float64
    covariance: Float64


def agreed(T_odom: Float64, edges: list[Edge]) -> Float64:
    """Poses that all motions agree on best; the first one stays.

    Args:
        T_odom: (N, 4, 4) poses of the left camera, near the solution.
        edges: between them, numbered by their place in `T_odom`.

    Returns:
        (N, 4, 4).

    Source: Grisetti et al., A Tutorial on Graph-Based SLAM, 2010, with twists on the right.
    """
    information = [np.asarray(np.linalg.inv(edge.covariance)) for edge in edges]
    T = T_odom.copy()
    for _ in range(ITERATIONS):
        step = _step(T, edges, information)
        T = T @ np.stack([exp_twist(twist) for twist in step])
        if np.abs(step).max() < CONVERGED:
            break
    return T


def _step(T: Float64, edges: list[Edge], information: list[Float64]) -> Float64:
    """(N, 6) twists that lead to agreement."""
    n = len(T)
    H, b = np.zeros((n, n, 6, 6)), np.zeros((n, 6))
    H[0, 0] += FIXED * np.eye(6)
    for edge, sure in zip(edges, information, strict=True):
        i, j = edge.first, edge.second
        T_j_i = inverted(T[j]) @ T[i]
        error = log_twist(inverted(edge.T_first_second) @ inverted(T_j_i))
        chi2 = float(np.einsum("i,ij,j", error, sure, error))
        weight = 1.0 / (1.0 + chi2 / (6 * KERNEL_SIGMA**2))
        weighted = sure * weight
        by_first = -adjoint(T_j_i)  # a twist of the later pose changes the error by itself
        H[i, i] += by_first.T @ weighted @ by_first
        H[i, j] += by_first.T @ weighted
        H[j, i] += weighted @ by_first
        H[j, j] += weighted
        b[i] -= by_first.T @ weighted @ error
        b[j] -= weighted @ error
    flat = H.transpose(0, 2, 1, 3).reshape(6 * n, 6 * n)
    return np.asarray(np.linalg.solve(flat, b.ravel()).reshape(n, 6))
