"""Whether a scan says that the sensors are not where vision's step leads to.

Most of a picture may show something that moves by itself, and vision then moves along with that. A
LiDAR sees all around: by the true step its scan lies on the map, by vision's it does not.
"""

from __future__ import annotations

from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping.alignment import Alignment
from pseudolidar.mapping.scan_witness import ScanPlanes, ScanWitness
from pseudolidar.mapping.steps_apart import apart
from pseudolidar.structures.arrays import Float64

# To overrule vision's step a scan must lie better elsewhere by so much of its score (0-1): a step
# that is 0.3 m too long or short costs 0.05 on drive 0002 and 0.1 on rendered worlds (2026-11).
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
    """A pose elsewhere, by which the scan lies far better on the map than by vision's step.

    It is looked for only where that step does not go on as before, or no motion is known yet.

    Args:
        scans: the map of the scans before.
        scan: of the frame, in the left camera's frame.
        T_from_to: (4, 4) vision's step: maps points of the later left camera to the earlier one.
        by_vision: where the scan lies near the end of that step; None where it does not lie on the
            map there.
        T_from: (4, 4) `T_odom_camera` where the step begins.
        T_guess: (4, 4) `T_odom_camera` if the sensors go on as before; None where no motion is
            known yet.

    Returns:
        None where vision's step stands.
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
