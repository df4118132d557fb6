"""Meshes without crumbs, and with fewer triangles."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.mesh_holes import parts
from pseudolidar.geometry.open3d_library import load_open3d
from pseudolidar.structures.mesh import Mesh


def cleaned(mesh: Mesh, *, smallest_part_m2: float) -> Mesh:
    """The mesh without triangles of no area and without parts smaller than `smallest_part_m2`."""
    a, b, c = mesh.triangles.T
    mesh = mesh.only((a != b) & (b != c) & (c != a))
    part = parts(mesh)
    part_m2 = np.bincount(part, mesh.areas_m2, minlength=1)
    return mesh.only(part_m2[part] >= smallest_part_m2)


def ordered(mesh: Mesh) -> Mesh:
    """The mesh with vertices and triangles by where they are; vertices alike become one.

    open3d's blocks come in any order: without this no two runs would write the same bytes.
    """
    columns = [mesh.vertices, *([] if mesh.normals is None else [mesh.normals])]
    columns += [] if mesh.rgb is None else [mesh.rgb.astype(np.float32)]
    rows = np.ascontiguousarray(np.concatenate(columns, axis=1))
    _, kept, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    triangles = number.reshape(-1)[mesh.triangles]
    turn = triangles.argmin(axis=1)[:, None] + np.arange(3)  # the lowest number first
    triangles = np.take_along_axis(triangles, turn % 3, axis=1)
    triangles = triangles[np.lexsort(triangles.T[::-1])].astype(np.int32)
    return Mesh(
        mesh.vertices[kept],
        triangles,
        mesh.frame,
        None if mesh.rgb is None else mesh.rgb[kept],
        None if mesh.normals is None else mesh.normals[kept],
    )


def decimated(mesh: Mesh, triangles: int) -> Mesh:
    """At most about `triangles` triangles, merged where the surface changes least by it.

    Source: Garland & Heckbert, Surface simplification using quadric error metrics, 1997, as
    open3d has it.
    """
    if len(mesh) <= triangles:
        return mesh
    open3d = load_open3d()
    as_vectors = open3d.utility.Vector3dVector
    full = open3d.geometry.TriangleMesh(
        as_vectors(mesh.vertices.astype(np.float64)), open3d.utility.Vector3iVector(mesh.triangles)
    )
    if mesh.rgb is not None:
        full.vertex_colors = as_vectors(mesh.rgb / 255.0)
    few = full.simplify_quadric_decimation(triangles)
    few.remove_degenerate_triangles()
    few.compute_vertex_normals()
    return Mesh(
        np.asarray(few.vertices).astype(mesh.vertices.dtype),
        np.asarray(few.triangles).astype(np.int32),
        mesh.frame,
        None if mesh.rgb is None else np.rint(255 * np.asarray(few.vertex_colors)).astype(np.uint8),
        np.asarray(few.vertex_normals).astype(np.float32),
    )
