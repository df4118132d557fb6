"""Whether an estimate knows how unsure it is: its errors, measured in its own covariances.

Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
section 5.4 (NEES), by the number of dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.pose_doubt import step_doubt
from pseudolidar.geometry.twists import inverted, log_twist
from pseudolidar.structures.arrays import Float64

DIMENSIONS = 6
# A covariance whose least variance is this share of its largest is held by rounding alone: steps
# hold 1e-7 of it, differences of equal covariances 1e-17.
ROUNDING = 1e-12
# 95 % of an honest estimate's are between these: chi-squared of six dimensions, by six.
LOW, HIGH = 0.206, 2.408


@dataclass(frozen=True, eq=False)
class Consistency:
    """Normalised squared errors by their dimensions: 1 is honest, less careful, more too sure.

    Args:
        poses: (N,) of each pose, seen from the first; NaN of the first.
        steps: (N,) of the step to each pose; NaN of the first.
    """

    poses: Float64
    steps: Float64

    @property
    def medians(self) -> dict[str, float | None]:
        """Of poses and of steps; None where there is none."""
        both = {"poses": self.poses, "steps": self.steps}
        known = {name: values[np.isfinite(values)] for name, values in both.items()}
        return {name: float(np.median(v)) if len(v) else None for name, v in known.items()}


def consistency_of(
    T_world_estimate: Float64, covariance: Float64, T_world_true: Float64
) -> Consistency:
    """Of poses (N, 4, 4) with covariances (N, 6, 6) of twists on their right, 0 at the first.

    Steps are of poses one after the other, and what their covariances grew by.

    Args:
        T_world_estimate: poses.
        covariance: of them.
        T_world_true: where they should be, in any world.
    """
    own, true = (inverted(T[0]) @ T for T in (T_world_estimate, T_world_true))
    poses, steps = np.full(len(own), np.nan), np.full(len(own), np.nan)
    for i in range(1, len(own)):
        poses[i] = _normalised(own[i], true[i], covariance[i])
        step, step_true = inverted(own[i - 1]) @ own[i], inverted(true[i - 1]) @ true[i]
        steps[i] = _normalised(step, step_true, step_doubt(covariance[i - 1], covariance[i], step))
    return Consistency(poses, steps)


def _normalised(T: Float64, T_true: Float64, covariance: Float64) -> float:
    """NaN where the covariance does not hold all directions."""
    error = log_twist(inverted(T) @ T_true)
    values, vectors = np.linalg.eigh(covariance)
    if not values[0] > ROUNDING * values[-1]:
        return float("nan")
    return float(((vectors.T @ error) ** 2 / values).sum() / DIMENSIONS)
