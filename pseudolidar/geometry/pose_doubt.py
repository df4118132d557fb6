"""How unsure poses are, as (6, 6) covariances of twists on their right: what follows from them."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.twists import carried
from pseudolidar.structures.arrays import Float64


def step_doubt(before: Float64, now: Float64, T_from_to: Float64) -> Float64:
    """(6, 6) what a step (4, 4) added to the doubt of poses, from one (6, 6) to another.

    What they share may cancel: then nothing is left, and no negative variance.
    """
    added = now - carried(before, T_from_to)
    values, vectors = np.linalg.eigh(0.5 * (added + added.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def unsure_m(covariance: Float64) -> float:
    """How far a pose of this doubt (6, 6) may be off in its worst direction, one sigma, m."""
    return float(np.sqrt(max(0.0, np.linalg.eigvalsh(covariance[:3, :3])[-1])))
