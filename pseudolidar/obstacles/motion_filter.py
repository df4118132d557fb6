"""A Kalman filter of position, velocity, turn rate, and errors that stay.

State: x, y, z (m), velocity along them (m/s), turn rate about z (rad/s), and in sigmas of their own
the persistent parts of the errors along the ray and across it, and the rig's. All sums are made in
a fixed order by numpy's element-wise operations, without BLAS: the same input gives the same bits
for any number of threads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64

SIZE, TURN, LASTING, ASIDE, RIG = 10, 6, 7, 8, 9
PLACE, VELOCITY, MOTION = slice(0, 3), slice(3, 6), slice(3, 7)
# Below this angle a turn is computed by its series, rad.
SMALL_TURN = 1e-4
# Squared distances in sigmas from which a measurement is doubted, and from which it is no motion
# but a mistake, now or before.
DOUBTED, JUMP = 4.0, 9.0
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
    """How a thing moves, and how the errors of its place do.

    Args:
        wander_m_s: by how much its velocity changes within a second, one standard deviation.
        turn: whether and how it turns.
        error_lasts_s: for how long an error along the ray, or across, stays what it is; the rig's
            stays for ever.
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
        sigma_m: (3,) one standard deviation along each, without the rig's.
        persistent: (2,) shares of the variances along the ray and across it on the level that are
            the same in the next frame, 0-1.
        shared_m: one standard deviation, along the ray, of what is the same in every frame.
    """

    xyz: Float64
    axes: Float64
    sigma_m: Float64
    persistent: tuple[float, float]
    shared_m: float = 0.0

    def rows(self) -> tuple[tuple[Float64, float], ...]:
        """For each axis what of the state it measures, (10,), and the variance of the rest, m^2."""
        rows = []
        for index, (axis, sigma) in enumerate(zip(self.axes, self.sigma_m, strict=True)):
            h, share = np.zeros(SIZE), 0.0
            h[PLACE] = axis
            if index < len(self.persistent):
                share = self.persistent[index]
                h[LASTING + index] = math.sqrt(share) * sigma
            if index == 0:
                h[RIG] = self.shared_m
            rows.append((h, (1.0 - share) * float(sigma) ** 2))
        return tuple(rows)


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed of a thing.

    Args:
        mean: (10,) state.
        covariance: (10, 10) of it.
    """

    mean: Float64
    covariance: Float64

    @classmethod
    def begun(cls, place: Place, speed_m_s: float, turn: Straight | Turning) -> Belief:
        """Seen for the first time: at its place, at rest give or take its speed."""
        mean, covariance = np.zeros(SIZE), np.zeros((SIZE, SIZE))
        mean[PLACE] = place.xyz
        for index in (LASTING, ASIDE, RIG):
            covariance[index, index] = 1.0
        for axis, (h, own) in zip(place.axes, place.rows(), strict=True):
            stays = h.copy()
            stays[PLACE] = 0.0
            variance = own + float(summed(stays * stays))
            covariance[PLACE, PLACE] += variance * axis[:, None] * axis
            covariance[PLACE, :] -= axis[:, None] * stays
            covariance[:, PLACE] -= stays[:, None] * axis
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
        for index, keeps in ((TURN, keeps_turn), (LASTING, keeps_error), (ASIDE, keeps_error)):
            mean[index] *= keeps
            F[index, index] = keeps
        covariance = product(product(F, self.covariance), np.ascontiguousarray(F.T))
        covariance += _noise(seconds, dynamics, keeps_turn, keeps_error)
        return Belief(mean, 0.5 * (covariance + covariance.T))

    def seen_with_doubt(self, place: Place, seen: int) -> Belief:
        """What is believed after a measurement that may be worse than it says.

        What is farther off than two sigmas, along one of the axes, counts as if it were two: the
        measurement is less sure than it says, or what was believed is, the less often it was seen.
        What is farther off than three moves the place alone: things do not jump, measurements do.

        Args:
            place: what was measured.
            seen: how often the thing was seen before.
        """
        return self.seen(place, doubt=1.0 / (1.0 + seen))[0]

    def seen(self, place: Place, *, doubt: float | None = None) -> tuple[Belief, float, float]:
        """What is believed after a measurement; how far off it was, and how vague this is.

        Args:
            place: what was measured.
            doubt: of what is too far off, the share that the belief is to blame for, 0-1; None
                takes everything as it is.

        Returns:
            The belief, the squared Mahalanobis distance of the measurement (3 degrees of freedom),
            and the logarithm of the determinant of its covariance.
        """
        mean, P = self.mean, self.covariance.copy()
        distance = log_volume = 0.0
        # The axes' errors are independent, so one after the other is the same as all at once.
        for axis, (h, own) in zip(place.axes, place.rows(), strict=True):
            Ph = summed(P * h)
            variance = float(summed(Ph * h)) + own
            off = float(summed(axis * place.xyz) - summed(h * mean))
            far = off * off / variance
            distance += far
            log_volume += math.log(variance)
            if doubt is not None and far > DOUBTED:
                more = off * off / DOUBTED - variance
                P[PLACE, PLACE] += doubt * more * axis[:, None] * axis
                Ph[PLACE] += doubt * more * axis
                variance += more
            gain = Ph * (1.0 / variance)
            # The rig's error is reckoned with and never learnt (a Schmidt-Kalman filter): whatever
            # is wrong with a measurement would be taken for it, and would stay for ever.
            gain[RIG] = 0.0
            if doubt is not None and far > JUMP:
                gain[MOTION] = 0.0
            mean = mean + gain * off
            both = gain[:, None] * Ph
            P = P - both - both.T + variance * gain[:, None] * gain
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
    """The state later, on a circle or straight on, and its derivative (10, 10).

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
    """(10, 10) what is not foreseen: white acceleration, turns that change, errors that do."""
    Q = np.zeros((SIZE, SIZE))
    for axis, share in ((0, 1.0), (1, 1.0), (2, UPRIGHT_SHARE)):
        density = (share * dynamics.wander_m_s) ** 2
        Q[axis, axis] = density * seconds**3 / 3.0
        Q[axis, axis + 3] = Q[axis + 3, axis] = density * seconds**2 / 2.0
        Q[axis + 3, axis + 3] = density * seconds
    Q[TURN, TURN] = dynamics.turn.turn_rad_s**2 * (1.0 - keeps_turn**2)
    Q[LASTING, LASTING] = Q[ASIDE, ASIDE] = 1.0 - keeps_error**2
    return Q
