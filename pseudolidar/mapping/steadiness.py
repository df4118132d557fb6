"""How steadily a sensor moves, and how far it may then be from where it would have gone on to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pseudolidar.geometry.twists import adjoint, exp_twist, inverted
from pseudolidar.structures.arrays import Float64

# What a sensor is thought to do before it was watched, one standard deviation of its acceleration,
# m/s2 and rad/s2 (a car that brakes and steers): as many times as it counts against what is seen.
THOUGHT, THOUGHT_TIMES = np.repeat([2.0, 0.3], 3), 3


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
    ) -> Float64:
        """(6, 6) doubt of a pose that goes on from the last one as the last step went.

        An acceleration `a` shows half of it in that step, and goes on: it makes
        `a seconds (seconds + step_s) / 2` of error.

        Args:
            known: (6, 6) doubt of the last pose.
            step: (6, 6) of the step to it.
            twist_per_s: (6,) of that step.
            step_s: how long it took.
            seconds: since the last pose.
        """
        carried = adjoint(exp_twist(-seconds * twist_per_s))
        by_acceleration = self.variance * (0.5 * seconds * (seconds + step_s)) ** 2
        doubt = carried @ known @ carried.T + step * (seconds / step_s) ** 2
        return np.asarray(doubt + np.diag(by_acceleration))

    def between(
        self, known: Float64, step: Float64, T_first: Float64, step_s: float, seconds: float
    ) -> Float64:
        """(6, 6) doubt of a pose between two that are measured, on the straight way.

        Args:
            known: (6, 6) doubt of the earlier one.
            step: (6, 6) of the step from it to the later one.
            T_first: (4, 4) the pose between, in the earlier one.
            step_s: how long that step took.
            seconds: since the earlier one.
        """
        carried = adjoint(inverted(T_first))
        by_acceleration = self.variance * (0.5 * seconds * (step_s - seconds)) ** 2
        doubt = carried @ known @ carried.T + step * (seconds / step_s) ** 2
        return np.asarray(doubt + np.diag(by_acceleration))
