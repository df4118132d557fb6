"""When something reaches the camera's plane, and where it is then."""

from __future__ import annotations

import math

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, Contact

# It comes nearer when its closing speed is so many of its sigmas.
SURELY_CLOSING = 2.0


def contact_of(box: Box3D, relative_m_s: Float64, covariance: Float64) -> Contact | None:
    """The contact of a box with the plane of a camera; None where it surely does not come nearer.

    Both go straight on. t = d / c of the distance d of the nearest corner and the closing speed c,
    var t = (var d + t^2 var v + 2 t cov(d, v)) / c^2, and likewise across.

    Args:
        box: in a camera's frame.
        relative_m_s: (3,) its velocity relative to the camera, in that frame.
        covariance: (6, 6) of position and velocity in that frame.
    """
    corners = box.corners_m()
    distance_m = float(corners[:, 2].min())
    closing = -float(relative_m_s[2])
    var_d, var_v, both = (float(covariance[i]) for i in ((2, 2), (5, 5), (2, 5)))
    if distance_m <= 0 or closing <= SURELY_CLOSING * math.sqrt(max(var_v, 0.0)):
        return None
    time_s = distance_m / closing
    sigma_s = math.sqrt(max(var_d + time_s**2 * var_v + 2 * time_s * both, 0.0)) / closing
    moved = time_s * float(relative_m_s[0])
    var_x = covariance[0, 0] + time_s**2 * covariance[3, 3] + 2 * time_s * covariance[0, 3]
    across = float(relative_m_s[0]) * sigma_s
    return Contact(
        time_s,
        sigma_s,
        float(corners[:, 0].min()) + moved,
        float(corners[:, 0].max()) + moved,
        float(np.sqrt(max(float(var_x), 0.0) + across**2)),
    )
