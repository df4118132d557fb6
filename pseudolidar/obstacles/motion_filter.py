"""A Kalman filter of position, velocity, turn rate, and an error that stays.

State: x, y, z (m), velocity along them (m/s), turn rate about z (rad/s), and the persistent part of
the distance's error in its own sigmas. All sums are made in a fixed order by numpy's element-wise
operations, without BLAS: the same input gives the same bits for any number of threads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.structures.arrays import Float64

SIZE, TURN, LASTING = 8, 6, 7
PLACE, VELOCITY = slice(0, 3), slice(3, 6)
# Below this angle a turn is computed by its series, rad.
SMALL_TURN = 1e-4
# Squared Mahalanobis distance from which a measurement is doubted.
DOUBTED = 4.0
# What rises or sinks changes its velocity by this share of what it does on the level.
UPRIGHT_SHARE = 0.2


@dataclass(frozen=True)
class Straight:
    """Things go straight on: constant velocity."""

    @property
    def turn_rad_s(self) -> float:
        """None of them turns."""
        return 0.0

    @property
    def lasting_s(self) -> float:
        """For how long a turn goes on."""
        return 1.0


@dataclass(frozen=True)
class Turning:
    """Things may turn: constant turn rate and speed, the rate estimated with the rest.

    Args:
        turn_rad_s: one standard deviation of turn rates.
        lasting_s: for how long a turn goes on.
    """

    turn_rad_s: float = 0.25
    lasting_s: float = 1.5


@dataclass(frozen=True)
class Dynamics:
    """How a thing moves, and how the error of its distance does.

    Args:
        wander_m_s: by how much its velocity changes within a second, one standard deviation.
        turn: whether and how it turns.
        error_lasts_s: for how long an error of the distance stays what it is.
    """

    wander_m_s: float
    turn: Straight | Turning
    error_lasts_s: float


@dataclass(frozen=True, eq=False)
class Place:
    """A measured place with its error, which has three axes of its own.

    Args:
        xyz: (3,) m.
        axes: (3, 3) unit rows: along the ray, across it on the level, and across both.
        sigma_m: (3,) one standard deviation along each.
        persistent: share of the variance along the ray that is the same in the next frame, 0-1.
    """

    xyz: Float64
    axes: Float64
    sigma_m: Float64
    persistent: float


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed of a thing.

    Args:
        mean: (8,) state.
        covariance: (8, 8) of it.
    """

    mean: Float64
    covariance: Float64

    @classmethod
    def begun(cls, place: Place, speed_m_s: float, turn: Straight | Turning) -> Belief:
        """Seen for the first time: at its place, at rest give or take its speed."""
        mean, covariance = np.zeros(SIZE), np.zeros((SIZE, SIZE))
        mean[PLACE] = place.xyz
        for axis, sigma in zip(place.axes, place.sigma_m, strict=True):
            covariance[PLACE, PLACE] += sigma**2 * axis[:, None] * axis
        lasting = -math.sqrt(place.persistent) * place.sigma_m[0] * place.axes[0]
        covariance[PLACE, LASTING] = covariance[LASTING, PLACE] = lasting
        covariance[LASTING, LASTING] = 1.0
        level = speed_m_s**2
        covariance[3, 3] = covariance[4, 4] = level
        covariance[5, 5] = UPRIGHT_SHARE**2 * level
        covariance[TURN, TURN] = turn.turn_rad_s**2
        return cls(mean, covariance)

    def after(self, seconds: float, dynamics: Dynamics) -> Belief:
        """What is believed later, when nothing more was seen."""
        mean, F = _moved(self.mean, seconds)
        keeps_turn = math.exp(-seconds / dynamics.turn.lasting_s)
        keeps_error = math.exp(-seconds / dynamics.error_lasts_s)
        for index, keeps in ((TURN, keeps_turn), (LASTING, keeps_error)):
            mean[index] *= keeps
            F[index, index] = keeps
        covariance = product(product(F, self.covariance), np.ascontiguousarray(F.T))
        covariance += _noise(seconds, dynamics, keeps_turn, keeps_error)
        return Belief(mean, 0.5 * (covariance + covariance.T))

    def seen_with_doubt(self, place: Place) -> Belief:
        """What is believed after a measurement that may be worse than it says.

        One that is farther off than two sigmas counts as if its own sigma were as much larger.
        """
        after, distance, _ = self.seen(place)
        if distance <= DOUBTED:
            return after
        sigma_m = place.sigma_m * math.sqrt(distance / DOUBTED)
        return self.seen(replace(place, sigma_m=sigma_m))[0]

    def seen(self, place: Place) -> tuple[Belief, float, float]:
        """What is believed after a measurement; how far off it was, and how vague this is.

        Returns:
            The belief, the squared Mahalanobis distance of the measurement (3 degrees of freedom),
            and the logarithm of the determinant of its covariance.
        """
        mean, P = self.mean, self.covariance
        distance = log_volume = 0.0
        own = (1.0 - place.persistent, 1.0, 1.0)
        # The axes' errors are independent, so one after the other is the same as all at once.
        for row, (axis, sigma, share) in enumerate(
            zip(place.axes, place.sigma_m, own, strict=True)
        ):
            h = np.zeros(SIZE)
            h[PLACE] = axis
            if row == 0:
                h[LASTING] = math.sqrt(place.persistent) * sigma
            Ph = summed(P * h)
            variance = float(summed(Ph * h)) + share * sigma**2
            off = float(summed(axis * place.xyz) - summed(h * mean))
            mean = mean + Ph * (off / variance)
            P = P - Ph[:, None] * Ph * (1.0 / variance)
            distance += off * off / variance
            log_volume += math.log(variance)
        return Belief(mean, P), distance, log_volume


def summed(values: Float64) -> Float64:
    """Sum over the last axis, in order."""
    total: Float64 = values[..., 0]
    for index in range(1, values.shape[-1]):
        total = total + values[..., index]
    return total


def product(A: Float64, B: Float64) -> Float64:
    """(n, n) A B, each sum in order."""
    total: Float64 = A[:, 0, None] * B[0]
    for index in range(1, len(B)):
        total = total + A[:, index, None] * B[index]
    return total


def _moved(mean: Float64, seconds: float) -> tuple[Float64, Float64]:
    """The state later, on a circle or straight on, and its derivative (8, 8).

    Source: coordinated turn, Bar-Shalom, Li & Kirubarajan 2001, section 11.7.
    """
    vx, vy, vz, turn = (float(mean[i]) for i in (3, 4, 5, 6))
    along, aside, d_along, d_aside = _arc(turn, seconds)
    c, s = math.cos(turn * seconds), math.sin(turn * seconds)
    moved, F = mean.copy(), np.eye(SIZE)
    moved[0] += along * vx - aside * vy
    moved[1] += aside * vx + along * vy
    moved[2] += seconds * vz
    moved[3], moved[4] = c * vx - s * vy, s * vx + c * vy
    F[0, 3:5], F[1, 3:5], F[2, 5] = (along, -aside), (aside, along), seconds
    F[3, 3:5], F[4, 3:5] = (c, -s), (s, c)
    F[0, TURN], F[1, TURN] = d_along * vx - d_aside * vy, d_aside * vx + d_along * vy
    F[3, TURN] = -seconds * (s * vx + c * vy)
    F[4, TURN] = seconds * (c * vx - s * vy)
    return moved, F


def _arc(turn: float, seconds: float) -> tuple[float, float, float, float]:
    """Of a unit velocity's way along and aside, in seconds, and their derivatives by the turn."""
    angle = turn * seconds
    if abs(angle) < SMALL_TURN:
        half = 0.5 * seconds * seconds
        along = seconds * (1.0 - angle * angle / 6.0)
        return along, half * turn, -turn * seconds**3 / 3.0, half
    along, aside = math.sin(angle) / turn, (1.0 - math.cos(angle)) / turn
    return (
        along,
        aside,
        (seconds * math.cos(angle) - along) / turn,
        (seconds * math.sin(angle) - aside) / turn,
    )


def _noise(seconds: float, dynamics: Dynamics, keeps_turn: float, keeps_error: float) -> Float64:
    """(8, 8) what is not foreseen: white acceleration, turns that change, errors that do."""
    Q = np.zeros((SIZE, SIZE))
    for axis, share in ((0, 1.0), (1, 1.0), (2, UPRIGHT_SHARE)):
        density = (share * dynamics.wander_m_s) ** 2
        Q[axis, axis] = density * seconds**3 / 3.0
        Q[axis, axis + 3] = Q[axis + 3, axis] = density * seconds**2 / 2.0
        Q[axis + 3, axis + 3] = density * seconds
    Q[TURN, TURN] = dynamics.turn.turn_rad_s**2 * (1.0 - keeps_turn**2)
    Q[LASTING, LASTING] = 1.0 - keeps_error**2
    return Q
