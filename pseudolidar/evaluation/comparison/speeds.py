"""How fast a rig went at each of its frames, from where it stood at the frames beside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.structures.arrays import Float64

NS_PER_S = 1e9
# Frames farther apart say nothing about the speed at them.
LONGEST_GAP_S = 0.5


def forward_speeds(frames: Sequence[ComparedFrame]) -> Float64:
    """(N,) m/s at each frame, between the frames beside it; NaN where that is not known.

    A car moves along its optical axis: the speed is the way over the time, without a sign.

    Args:
        frames: in order of time.
    """
    speeds = np.full(len(frames), np.nan)
    for number in range(len(frames)):
        before, after = frames[max(number - 1, 0)], frames[min(number + 1, len(frames) - 1)]
        gap_s = (after.timestamp_ns - before.timestamp_ns) / NS_PER_S
        if before.place_m is None or after.place_m is None:
            continue
        steps = 2 if 0 < number < len(frames) - 1 else 1
        if 0 < gap_s <= steps * LONGEST_GAP_S:
            speeds[number] = np.linalg.norm(after.place_m - before.place_m) / gap_s
    return speeds
