"""Where a line of sight meets a surface of triangles."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.mesh import Mesh


def first_hit(mesh: Mesh, origin: Float64, direction: Float64) -> Float64 | None:
    """(3,) the place where a line from `origin` meets the surface first; None where it passes by.

    Both sides of a triangle count. The triangles that may be met are those whose shadow along the
    line holds it, which a look at their bounds tells; only these are cut.

    Args:
        mesh: the surface.
        origin: (3,) in the frame of the mesh.
        direction: (3,) of any length.

    Source: Moeller & Trumbore, Fast, minimum storage ray/triangle intersection, 1997.
    """
    towards = direction / np.linalg.norm(direction)
    shadow = (mesh.vertices - origin) @ _across(towards)  # (V, 2), the line is at 0, 0
    may = np.ones(len(mesh), bool)
    for axis in shadow.T:
        corners = axis[mesh.triangles]
        may &= (corners.min(axis=1) <= 0) & (corners.max(axis=1) >= 0)
    a, b, c = mesh.vertices[mesh.triangles[may]].transpose(1, 0, 2) - origin
    along = _along(a, b - a, c - a, towards)
    along = along[along > 0]
    return None if not len(along) else np.asarray(origin + along.min() * towards)


def _along(corner: Float64, one: Float64, other: Float64, towards: Float64) -> Float64:
    """(N,) m along a line from 0 to triangles of a corner and two sides; NaN beside them."""
    normal = np.cross(towards, other)
    scale = np.einsum("ni,ni->n", one, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = -np.einsum("ni,ni->n", corner, normal) / scale
        turned = np.cross(-corner, one)
        v = turned @ towards / scale
        along = np.einsum("ni,ni->n", other, turned) / scale
    return np.where((u >= 0) & (v >= 0) & (u + v <= 1), along, np.nan)


def _across(towards: Float64) -> Float64:
    """(3, 2) two axes at right angles to a direction and to each other."""
    least = np.eye(3)[np.argmin(np.abs(towards))]
    one = np.cross(towards, least)
    one /= np.linalg.norm(one)
    return np.stack([one, np.cross(towards, one)], axis=1)
