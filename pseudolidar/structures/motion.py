"""How a body moves at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64, check_array
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Velocity and rate of turn of a frame, in its own axes.

    Args:
        frame: what moves.
        velocity_m_s: (3,) of its origin.
        rate_rad_s: (3,) about its axes, by the right-hand rule.
    """

    frame: str
    velocity_m_s: Float64
    rate_rad_s: Float64

    def __post_init__(self) -> None:
        check_array("BodyMotion", "velocity_m_s", self.velocity_m_s, (3,), np.float64)
        check_array("BodyMotion", "rate_rad_s", self.rate_rad_s, (3,), np.float64)

    def at(self, T_sensor_body: Pose) -> BodyMotion:
        """The motion of a sensor that is fixed to the body, in the sensor's axes."""
        R = T_sensor_body.matrix[:3, :3]
        lever_m = T_sensor_body.inverse().translation_m
        velocity = self.velocity_m_s + np.cross(self.rate_rad_s, lever_m)
        return BodyMotion(T_sensor_body.dst, R @ velocity, R @ self.rate_rad_s)
