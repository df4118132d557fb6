"""How long paths are."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64


def travelled_m(places_m: Float64) -> Float64:
    """(N,) how far each place of a path is from its first one, along it, m.

    Args:
        places_m: (N, 3) places in order, at least one.
    """
    steps_m = np.linalg.norm(np.diff(places_m, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps_m)])


def length_m(places_m: Float64) -> float:
    """From the first place (N, 3) of a path to the last one, along it, m; of no place 0."""
    return float(travelled_m(places_m)[-1])
