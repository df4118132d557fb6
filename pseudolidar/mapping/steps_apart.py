"""Whether two steps of a camera differ by more than predictions usually do."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.twists import inverted, log_twist
from pseudolidar.structures.arrays import Float64

# A step this near to what was predicted needs no other witness: share of the way and least m, rad.
NEAR_SHARE, NEAR_M, NEAR_RAD = 0.08, 0.005, 0.012


def apart(one: Float64, other: Float64) -> bool:
    """Whether two steps (4, 4) from the same frame differ by more than predictions usually do."""
    difference = log_twist(inverted(one) @ other)
    way_m = max(float(np.linalg.norm(T[:3, 3])) for T in (one, other))
    far = np.linalg.norm(difference[:3]) > max(NEAR_M, NEAR_SHARE * way_m)
    return bool(far or np.linalg.norm(difference[3:]) > NEAR_RAD)
