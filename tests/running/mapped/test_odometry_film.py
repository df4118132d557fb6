"""What a film of odometry says below its pictures."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.mapping.integrity import StepCheck, step_check
from pseudolidar.mapping.registered import Registered
from pseudolidar.running.mapped.odometry_film import checks_in_words
from pseudolidar.structures.odometry import OdometryState
from pseudolidar.structures.pose import Pose


def test_who_was_asked_about_a_step_and_what_they_said():
    pose = Pose.identity(ODOM, "camera_left")
    seen, dark = OdometryState("ok", pose), OdometryState("ok", pose, why="dark")
    step, other = np.eye(4), exp_twist(np.array([0, 0, 0.8, 0, 0.1, 0]))
    right = step_check("map", False, step, other, 0.7, 0.6)
    wrong = step_check("scans", True, step, other, 0.5, 0.8)
    assert [
        checks_in_words(one)
        for one in (
            Registered(seen, StepCheck("none", False, step), sensors="vision"),
            Registered(OdometryState("lost")),
            Registered(dark, sensors="scan"),
            Registered(seen, sensors="scan"),
            Registered(seen, right, sensors="vision"),
            Registered(seen, wrong, sensors="scan"),
        )
    ] == [
        "goes on as before",
        "lost",
        "by the scan alone: dark",
        "by the scan alone",
        "the step agrees with the map",
        "the step disagrees with the scans: another one is taken, 0.80 m and 5.73 deg from it",
    ]
