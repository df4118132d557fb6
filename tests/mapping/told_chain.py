"""Odometry whose states are given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.geometry.frames import ODOM
from pseudolidar.geometry.twists import carried, exp_twist
from pseudolidar.mapping.path import stacked
from pseudolidar.mapping.registered import Registered
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import CameraStep, OdometryState
from pseudolidar.structures.pose import Pose, Trajectory

UNKNOWN = DisparityMap(np.full((32, 64), np.nan, np.float32))
STEP_DOUBT = np.diag(np.repeat([1e-3, 1e-4], 3) ** 2)


class ToldChain:
    """Tells one state after the other."""

    correction = scan_counts = None

    def __init__(self, states: Sequence[OdometryState]) -> None:
        self._states = list(states)
        self._told: list[tuple[int, OdometryState]] = []

    def register(self, frame: StereoFrame, *_seen: object) -> Registered:
        """The next one."""
        state = self._states[len(self._told)]
        self._told.append((frame.timestamp_ns, state))
        return Registered(state, sensors="vision" if state.measured else "none")

    def trajectories(self) -> tuple[Trajectory, ...]:
        """What was told, piece by piece."""
        pieces = []
        for number in sorted({state.piece for _, state in self._told}):
            told = [one for one in self._told if one[1].piece == number and one[1].measured]
            poses = [state.T_odom_camera.matrix for _, state in told]
            pieces.append(
                stacked([time for time, _ in told], poses, [state.covariance for _, state in told])
            )
        return tuple(pieces)


def going(twist_per_s, statuses: str, *, dt_s=0.1, doubt=None):
    """States at one velocity: `f` is the first of a piece, `o` ok, `x` lost."""
    states, piece, since, covariance = [], -1, 0, np.zeros((6, 6))
    T_step = exp_twist(dt_s * np.asarray(twist_per_s))
    for status in statuses:
        since += 1
        if status == "x":
            states.append(OdometryState("lost", piece=max(0, piece), why="it is dark"))
            continue
        if status == "f":
            piece, since, T = piece + 1, 0, np.eye(4)
            covariance = np.zeros((6, 6)) if doubt is None else doubt
            step = None
        else:
            T_from_to = np.linalg.matrix_power(T_step, since)
            T, since = T @ T_from_to, 0
            covariance = carried(covariance, T_from_to) + STEP_DOUBT
            step = CameraStep(T_from_to, STEP_DOUBT)
        states.append(
            OdometryState(
                "first" if status == "f" else "ok",
                Pose(ODOM, "left", T),
                step=step,
                covariance=covariance,
                piece=piece,
            )
        )
    return states


def frames_for(states, *, dt_s=0.1):
    """Pairs that show nothing, one for each state."""
    rig = Synthetic("street", width_px=64, height_px=32).open().rig
    grey = np.zeros((32, 64), np.uint8)
    return [
        StereoFrame(grey, grey, rig, f"{i:06d}", i, round((1 + i * dt_s) * 1e9))
        for i in range(len(states))
    ]
