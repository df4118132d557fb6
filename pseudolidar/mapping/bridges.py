"""Poses of frames between those that were measured, once both sides of the gap are known."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.pose_doubt import step_doubt
from pseudolidar.geometry.twists import exp_twist, inverted, log_twist, rigid
from pseudolidar.mapping.path import stacked
from pseudolidar.mapping.steadiness import Guessed, Steadiness
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.pose import Trajectory


def bridged(path: Trajectory, times_ns: Int64) -> Trajectory:
    """The path with poses at more times between its own: each gap at one velocity.

    Better than what could be told at the time, when the far side of the gap was not known. No end
    of a path is made of such poses.

    Args:
        path: of frames that were measured; with covariances.
        times_ns: (M,) int64 of frames that were not, increasing, none of the path's own. Those
            before its first pose or after its last one are left out, and those of gaps so long
            that what nobody measured would put a pose in them off by more than a metre.

    Returns:
        All of them in order of time; `extrapolated` marks those that were added.

    Raises:
        StructureError: the path has no covariances.
    """
    own, steadiness = path.timestamps_ns, steadiness_of(path)
    rows = [
        (int(time_ns), T, doubt, False)
        for time_ns, T, doubt in zip(own, path.T_world_body, path.doubts, strict=True)
    ]
    after = np.searchsorted(own, times_ns)
    for time_ns, at in zip(times_ns.tolist(), after.tolist(), strict=True):
        if 0 < at < len(own):
            T, doubt = _between(path, at - 1, time_ns, steadiness)
            if not doubt.too_unsure:
                rows.append((time_ns, T, doubt.total, True))
    rows.sort(key=lambda row: row[0])
    times, poses, doubts, added = zip(*rows, strict=True)
    return replace(stacked(times, poses, doubts), extrapolated=np.array(added, np.bool_))


def steadiness_of(path: Trajectory) -> Steadiness:
    """How steadily the sensor moved along all of a path."""
    seconds = np.diff(path.timestamps_ns) / NS_PER_S
    twists = [
        log_twist(inverted(before) @ after) / each
        for (before, after), each in zip(
            itertools.pairwise(path.T_world_body), seconds, strict=True
        )
    ]
    steadiness = Steadiness()
    for i in range(1, len(twists)):
        apart_s = float(0.5 * (seconds[i - 1] + seconds[i]))
        steadiness = steadiness.after(twists[i - 1], twists[i], apart_s)
    return steadiness


def _between(
    path: Trajectory, first: int, time_ns: int, steadiness: Steadiness
) -> tuple[Float64, Guessed]:
    """Pose (4, 4) between two of the path, and its doubt."""
    start_ns, end_ns = path.timestamps_ns[first : first + 2].tolist()
    before, after = path.T_world_body[first : first + 2]
    known, known_after = path.doubts[first : first + 2]
    step = inverted(before) @ after
    share = (time_ns - start_ns) / (end_ns - start_ns)
    T_first = exp_twist(share * log_twist(step))
    doubt = steadiness.between(
        known,
        step_doubt(known, known_after, step),
        T_first,
        (end_ns - start_ns) / NS_PER_S,
        (time_ns - start_ns) / NS_PER_S,
    )
    return rigid(before @ T_first), doubt
