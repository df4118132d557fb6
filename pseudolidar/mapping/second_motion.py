"""Which of several motions in a picture is the camera's, where some of what it shows moves itself.

What most corners are on may move by itself: a bus beside the camera has more of them than the
street. The rest of the picture has a motion of its own then, and one of them is the camera's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.pnp import RelativePose
from pseudolidar.geometry.tracking import Seeds
from pseudolidar.geometry.triangulation import points_by_q
from pseudolidar.geometry.twists import inverted, log_twist
from pseudolidar.mapping.steps_apart import apart
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig

# What no camera does from one frame to the next: a car on dry asphalt brakes with 10 m/s2; the car
# of KITTI 00 turns by 0.33 rad/s2 (one standard deviation, `steadiness.py`), hands by far more.
MOST_M_S2, MOST_RAD_S2 = 10.0, 10.0
# Side of cells in which points are counted, px, so that what has much texture has no more say than
# what has little; a cell says something with so many points.
CELL_PX, LEAST_IN_CELL = 54, 2
# Shares of points that lie outside of the box that tells how large a thing is; one is larger than
# another if it is by this factor. Buses have 10 to 14 m, streets 25 to 35 m (rendered, 2026-11).
OUTSIDE, LARGER = 0.1, 1.5


@dataclass(frozen=True, eq=False)
class Expected:
    """The motion if the camera goes on as before.

    Args:
        T_to_from: (4, 4) from the keyframe.
        seconds: since the last frame that was placed.
    """

    T_to_from: Float64
    seconds: float

    def comes_true(self, motion: RelativePose) -> bool:
        """Whether it is that motion, as near as predictions usually are."""
        return not apart(motion.T_to_from, self.T_to_from)

    def allows(self, motion: RelativePose) -> bool:
        """Whether a camera that moved as before can have moved like that."""
        difference = log_twist(inverted(motion.T_to_from) @ self.T_to_from)
        far = np.linalg.norm(difference[:3]) > MOST_M_S2 * self.seconds**2
        turned = np.linalg.norm(difference[3:]) > MOST_RAD_S2 * self.seconds**2
        return self.comes_true(motion) or not bool(far or turned)


def left_over(seeds: Seeds, motions: Sequence[RelativePose]) -> Seeds:
    """Corners that agree with none of some motions."""
    known = {tuple(uv) for one in motions for uv in _agreeing(one).tolist()}
    return seeds[np.array([tuple(uv) not in known for uv in seeds.uv.tolist()], np.bool_)]


def camera_motion(
    motions: Sequence[RelativePose], expected: Expected | None, rig: StereoRig
) -> RelativePose:
    """Which of some motions is the camera's.

    Those that a camera can have done, where some are. Of these that whose points are spread through
    the largest part of space: things that move are smaller than the world. Of parts alike that of
    the larger part of the picture. That one goes on as before is no reason: so does the car ahead,
    when both set off.

    Args:
        motions: one at least.
        expected: None where nothing is known.
        rig: rectified.
    """
    done = [one for one in motions if expected is not None and expected.allows(one)]
    asked = done or motions
    sizes_m = [extent_m(one, rig) for one in asked]
    large = [
        one for one, size_m in zip(asked, sizes_m, strict=True) if LARGER * size_m > max(sizes_m)
    ]
    return max(large, key=cells)


def cells(motion: RelativePose) -> int:
    """How many cells of the picture agree with a motion."""
    cell = (_agreeing(motion) // CELL_PX).astype(np.int64)
    _, counts = np.unique(cell, axis=0, return_counts=True)
    return int((counts >= LEAST_IN_CELL).sum())


def extent_m(motion: RelativePose, rig: StereoRig) -> float:
    """How large the box is that holds most points that agree with a motion: its diagonal."""
    agree = motion.weights >= 0.5
    u, v = motion.tracks.uv_from[agree].T
    points = points_by_q(motion.tracks.d_from[agree], u, v, rig)
    low, high = np.quantile(points, (OUTSIDE, 1 - OUTSIDE), axis=0)
    return float(np.linalg.norm(high - low))


def _agreeing(motion: RelativePose) -> Float64:
    """(N, 2) px of the points that agree with a motion, in the earlier picture."""
    return motion.tracks.uv_from[motion.weights >= 0.5]
