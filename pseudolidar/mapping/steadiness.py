"""How steadily a sensor moves, and how far it may then be from where it would have gone on to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pseudolidar.geometry.pose_doubt import unsure_m
from pseudolidar.geometry.twists import adjoint, carried, exp_twist, inverted
from pseudolidar.structures.arrays import Float64

# What a sensor is thought to do before it was watched, one standard deviation of its acceleration,
# m/s2 and rad/s2: the car of KITTI 00 does 1.5 and 0.33 on its worst axes (2026-11,
# `python -m tests.benchmarks.extrapolated`).
THOUGHT = np.repeat([2.0, 0.3], 3)
# That counts as so many changes of motion that were seen: soon what is seen says more.
THOUGHT_TIMES = 3
# A pose that may be off by more, one standard deviation, m, by what nobody measured, is none: a
# lane is 3 m wide, and within a metre the pose is still in its own. Chosen, 2026-11.
MOST_GUESSED_M = 1.0


@dataclass(frozen=True, eq=False)
class Guessed:
    """How unsure a pose is that nothing was measured of.

    Args:
        total: (6, 6) in all, drift since the path began included.
        own: (6, 6) what of it is of the time in which nothing was measured.
    """

    total: Float64
    own: Float64

    @property
    def too_unsure(self) -> bool:
        """Whether it is none: long paths drift, and may still be told on across a gap."""
        return unsure_m(self.own) > MOST_GUESSED_M


@dataclass(frozen=True, eq=False)
class Steadiness:
    """Accelerations of a sensor, as they were seen.

    Args:
        squares: (6,) sum of squares, of the twist's six numbers, by s4.
        times: how many were summed.
    """

    squares: Float64 = field(default_factory=lambda: THOUGHT_TIMES * THOUGHT**2)
    times: int = THOUGHT_TIMES

    def after(self, before_per_s: Float64, now_per_s: Float64, seconds: float) -> Steadiness:
        """With one more change of twist (6,) by s, from one to another so many seconds later."""
        acceleration = (now_per_s - before_per_s) / seconds
        return Steadiness(self.squares + acceleration**2, self.times + 1)

    @property
    def variance(self) -> Float64:
        """(6,) of accelerations."""
        return self.squares / self.times

    def gone_on(
        self, known: Float64, step: Float64, twist_per_s: Float64, step_s: float, seconds: float
    ) -> Guessed:
        """The doubt of a pose that goes on from the last one as the last step went.

        An acceleration `a` shows half of it in that step, and goes on: it makes
        `a seconds (seconds + step_s) / 2` of error. What the step itself was wrong by is in the
        last pose once, and again in every further step.

        Args:
            known: (6, 6) doubt of the last pose.
            step: (6, 6) of the step to it. What an unknown offset of the rig adds to that is not
                asked for: it changes lengths by a share, far less than accelerations do.
            twist_per_s: (6,) of that step.
            step_s: how long it took.
            seconds: since the last pose.
        """
        times, T_on = seconds / step_s, exp_twist(seconds * twist_per_s)
        by_acceleration = self.variance * (0.5 * seconds * (seconds + step_s)) ** 2
        own = np.asarray(step * times**2 + np.diag(by_acceleration))
        shared = times * adjoint(inverted(T_on)) @ step
        return Guessed(carried(known, T_on) + shared + shared.T + own, own)

    def between(
        self, known: Float64, step: Float64, T_first: Float64, step_s: float, seconds: float
    ) -> Guessed:
        """The doubt of a pose between two that are measured, on the straight way.

        Args:
            known: (6, 6) doubt of the earlier one.
            step: (6, 6) of the step from it to the later one.
            T_first: (4, 4) the pose between, in the earlier one.
            step_s: how long that step took.
            seconds: since the earlier one.
        """
        by_acceleration = self.variance * (0.5 * seconds * (step_s - seconds)) ** 2
        own = np.asarray(step * (seconds / step_s) ** 2 + np.diag(by_acceleration))
        return Guessed(carried(known, T_first) + own, own)
