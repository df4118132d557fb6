"""Whether a scan says that the sensors are not where vision's step leads to.

Most of a picture may be on something that moves by itself, and vision goes with that: a LiDAR sees
all around, and the street lies on its map by another step.
"""

from __future__ import annotations

from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping.alignment import Alignment
from pseudolidar.mapping.scan_witness import ScanPlanes, ScanWitness
from pseudolidar.mapping.steps_apart import apart
from pseudolidar.structures.arrays import Float64

# The scan must lie better by so much of its score than by vision's step to overrule it: steps that
# are 0.3 m too long or short cost 0.05 on drive 0002 and 0.1 on rendered worlds (2026-11).
SCAN_FOR = 0.03


def lying_elsewhere(
    scans: ScanWitness,
    scan: ScanPlanes,
    T_from_to: Float64,
    by_vision: Alignment | None,
    *,
    T_from: Float64,
    T_guess: Float64 | None,
) -> Alignment | None:
    """Where a scan lies far better than by vision's step; None where it speaks for that.

    It is asked where the step is not as before, or nothing was before.

    Args:
        scans: the map of those before.
        scan: of the frame.
        T_from_to: (4, 4) vision's step.
        by_vision: how the scan lies near where that leads to; None where it does not.
        T_from: (4, 4) where the step begins, in `odom`.
        T_guess: (4, 4) where the sensors would go on to; None where no motion was seen before.
    """
    if T_guess is None:
        T_guess = scans.ahead(scan, T_from)
    elif not apart(T_from_to, inverted(T_from) @ T_guess):
        return None
    other = scans.alone(scan, T_guess)
    if other is None or not apart(T_from_to, inverted(T_from) @ other.T_odom_sensor):
        return None
    far_better = by_vision is None or other.score > by_vision.score + SCAN_FOR
    return other if far_better else None
