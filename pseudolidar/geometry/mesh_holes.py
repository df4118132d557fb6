"""Edges of meshes: parts that hang together, borders, and the holes in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float64, Int64
from pseudolidar.structures.mesh import Mesh


@dataclass(frozen=True)
class Openings:
    """Where a mesh ends.

    Args:
        edges: edges that belong to one triangle only.
        edges_m: their length in all.
        borders: closed chains of them: one around each part, the others are holes in it.
        holes: borders but the longest of each part.
        holes_m2: area of the holes, each as the fan of triangles about its middle.
        largest_hole_m2: the largest of them.
    """

    edges: int
    edges_m: float
    borders: int
    holes: int
    holes_m2: float
    largest_hole_m2: float


def parts(mesh: Mesh) -> Int64:
    """(T,) number of the part that each triangle belongs to; parts share no vertex."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    n, (a, b, c) = len(mesh.vertices), mesh.triangles.T
    one = np.ones(2 * len(mesh), np.int8)
    touching = coo_matrix((one, (np.r_[a, b], np.r_[b, c])), shape=(n, n))
    _, part = connected_components(touching, directed=False)
    return np.asarray(part[a], np.int64)


def boundary_edges(mesh: Mesh) -> AnyArray:
    """(E, 2) vertex numbers of edges that one triangle only has, in its direction."""
    edges = mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = edges.min(axis=1).astype(np.int64), edges.max(axis=1).astype(np.int64)
    key = low * max(len(mesh.vertices), 1) + high
    _, first, counts = np.unique(key, return_index=True, return_counts=True)
    return np.asarray(edges[first[counts == 1]])


def openings(mesh: Mesh) -> Openings:
    """Borders and holes of a mesh; a closed one has none.

    Borders that meet in a vertex count as one, which merges small holes that touch.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = boundary_edges(mesh)
    if not len(edges):
        return Openings(0, 0.0, 0, 0, 0.0, 0.0)
    used, ends = np.unique(edges, return_inverse=True)
    ends = ends.reshape(-1, 2)
    links = coo_matrix(
        (np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), shape=(len(used), len(used))
    )
    borders, border_of_vertex = connected_components(links, directed=False)
    border = border_of_vertex[ends[:, 0]].astype(np.int64)
    a, b = mesh.vertices[edges].astype(np.float64).transpose(1, 0, 2)
    length_m = np.linalg.norm(b - a, axis=1)
    area_m2 = _fans(a, b, border, borders)
    around_m = np.bincount(border, length_m, borders)
    part_of_vertex = np.zeros(len(mesh.vertices), np.int64)
    part_of_vertex[mesh.triangles.ravel()] = np.repeat(parts(mesh), 3)
    part = np.zeros(borders, np.int64)
    part[border] = part_of_vertex[edges[:, 0]]
    order = np.lexsort((-around_m, part))
    hole = np.ones(borders, bool)
    hole[order[np.r_[True, np.diff(part[order]) != 0]]] = False
    holes_m2 = area_m2[hole]
    return Openings(
        len(edges), float(length_m.sum()), borders, int(hole.sum()),
        float(holes_m2.sum()), float(holes_m2.max(initial=0.0)),
    )  # fmt: skip


def _fans(a: Float64, b: Float64, border: Int64, borders: int) -> Float64:
    """(borders,) area of each chain of edges `a` to `b`, as a vector sum about its middle."""
    weight = np.maximum(np.bincount(border, minlength=borders), 1)
    middle = np.stack([np.bincount(border, a[:, i], borders) / weight for i in range(3)], axis=1)
    normals = np.cross(a - middle[border], b - middle[border]) / 2
    summed = np.stack([np.bincount(border, normals[:, i], borders) for i in range(3)], axis=1)
    return np.asarray(np.linalg.norm(summed, axis=1))
