"""Normals of a surface of triangles, and places on it."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float64
from pseudolidar.structures.mesh import Mesh

# Of chance: the same places every time.
SEED = 7


def vertex_normals(mesh: Mesh) -> Float64:
    """(V, 3) of length 1, triangles weighed by their area; 0 where a vertex has none."""
    a, b, c = mesh.corners.astype(np.float64).transpose(1, 0, 2)
    of_triangles = np.cross(b - a, c - a)
    normals = np.zeros((len(mesh.vertices), 3))
    for corner in mesh.triangles.T:
        for axis in range(3):
            normals[:, axis] += np.bincount(corner, of_triangles[:, axis], len(normals))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0, length, 1)


def spread_over(mesh: Mesh, count: int) -> tuple[AnyArray, Float64]:
    """Places on a surface, as many on each square metre.

    Args:
        mesh: at least one triangle with an area.
        count: how many.

    Returns:
        (count, 3) vertex numbers and (count, 3) their weights, of sum 1: a place, or a colour
        there, is the weighted mean of those of the vertices.

    Source: Osada et al., Shape distributions, 2002, section 4.2 (places within a triangle).
    """
    rng = np.random.default_rng(SEED)
    reached_m2 = np.cumsum(mesh.areas_m2)
    # One in each of `count` parts of the same area: no heaps and no holes.
    at_m2 = (np.arange(count) + rng.random(count)) / count * reached_m2[-1]
    which = np.minimum(np.searchsorted(reached_m2, at_m2, side="right"), len(mesh) - 1)
    root, share = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - root, root * (1 - share), root * share], axis=1)
    return mesh.triangles[which], weights
