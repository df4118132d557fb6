"""Which of several motions in a picture is the camera's, where parts of it move by themselves.

Most corners may be on something that moves by itself: a bus beside the camera has more of them than
the street. The rest of the picture then moves differently, and one of the two motions is the
camera's.
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
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.odometry import AGREES

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
    """The motion from a keyframe to a frame if the camera goes on as before.

    Args:
        T_to_from: (4, 4) maps points of the keyframe's left camera to the frame's, m.
        seconds: since the last frame that was placed, s.
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
    """The corners of a keyframe that agree with none of the motions found so far.

    Args:
        seeds: corners; tracks of motions begin at the very same pixels.
        motions: from that keyframe.
    """
    known = {tuple(uv) for one in motions for uv in _agreeing_uv(one).tolist()}
    return seeds[np.array([tuple(uv) not in known for uv in seeds.uv.tolist()], np.bool_)]


def camera_motion(
    motions: Sequence[RelativePose], expected: Expected | None, rig: StereoRig
) -> RelativePose:
    """Which of several motions is the camera's.

    Motions that no camera can do are left out, unless all are such. Of the others the one whose
    points spread through the largest part of space is the camera's, for things that move are
    smaller than the world; where several spread about as far, the one that agrees with the larger
    part of the picture. It does not count that a motion goes on as before: the car ahead seems to
    stand still before and after both cars set off.

    Args:
        motions: from the same keyframe to the same frame; one at least.
        expected: the motion if the camera goes on as before; None where that is unknown.
        rig: rectified.
    """
    done = [one for one in motions if expected is not None and expected.allows(one)]
    asked = done or motions
    sizes_m = [extent_m(one, rig) for one in asked]
    large = [
        one for one, size_m in zip(asked, sizes_m, strict=True) if LARGER * size_m >= max(sizes_m)
    ]
    return max(large, key=cells)


def cells(motion: RelativePose) -> int:
    """How many cells of the picture, `CELL_PX` wide and high, agree with a motion."""
    cell = (_agreeing_uv(motion) // CELL_PX).astype(np.int64)
    _, counts = np.unique(cell, axis=0, return_counts=True)
    return int((counts >= LEAST_IN_CELL).sum())


def extent_m(motion: RelativePose, rig: StereoRig) -> float:
    """Diagonal of the box that holds most of the points that agree with a motion, m.

    Along each axis of the left camera a share `OUTSIDE` of them lies beyond either end of it. It is
    0 where no point agrees.
    """
    agree = agreeing(motion)
    if not agree.any():
        return 0.0
    u, v = motion.tracks.uv_from[agree].T
    points = points_by_q(motion.tracks.d_from[agree], u, v, rig)
    low, high = np.quantile(points, (OUTSIDE, 1 - OUTSIDE), axis=0)
    return float(np.linalg.norm(high - low))


def agreeing(motion: RelativePose) -> Bool:
    """(N,) which tracks of a motion agree with it."""
    return np.asarray(motion.weights >= AGREES)


def _agreeing_uv(motion: RelativePose) -> Float64:
    """(M, 2) px of the points that agree with a motion, in the earlier picture."""
    return motion.tracks.uv_from[agreeing(motion)]
