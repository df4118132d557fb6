"""Meshes that lie still: read from their files, within what a browser draws, and their colours."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from pseudolidar.errors import LimitError, PointFileCorrupt, PseudolidarError
from pseudolidar.formats.meshes.mesh_file import ENCODERS, read_mesh
from pseudolidar.formats.points.ply import ply_facts
from pseudolidar.geometry.cloud_frames import turned_forward
from pseudolidar.mapping.mesh_cleaning import decimated
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.mesh import Mesh
from pseudolidar.viewer.colouring import Colouring
from pseudolidar.viewer.moment import FARTHEST_M
from pseudolidar.viewer.stills import StillMesh

_log = logging.getLogger(__name__)

# Triangles that a browser draws; of more, as many are merged. It takes a core 12 s for each
# million that is too many, so that still larger meshes are refused.
MOST_TRIANGLES, MOST_READ = 1_000_000, 5_000_000


def is_mesh_file(path: Path) -> bool:
    """Whether a file is one of meshes: by its extension, a PLY by the faces that it promises.

    Raises:
        PointFileMissing, PointFileHeader, PointFileTruncated: a PLY whose header says nothing.
    """
    suffix = path.suffix.lower()
    if suffix != ".ply":
        return suffix.removeprefix(".") in ENCODERS
    try:
        return any(name == "face" and count > 0 for name, count in ply_facts(path).others)
    except PseudolidarError as error:
        raise error.located(path) from error.__cause__


def read_still_mesh(name: str, path: Path) -> StillMesh:
    """The mesh of a file, with x forward, y left, z up, and with no more triangles than are drawn.

    Raises:
        LimitError: so many triangles that it would take minutes to have fewer.
        PointFileCorrupt: no triangle that has an area.
        PseudolidarError: as the reader of its format.
    """
    mesh = read_mesh(path)
    if len(mesh) > MOST_READ:
        raise LimitError(
            f"{len(mesh):,} triangles",
            want=f"at most {MOST_READ:,}",
            fix=f"Make fewer: pseudolidar map ... --mesh --map.mesh.triangles {MOST_TRIANGLES}.",
            path=path,
        )
    mesh = _somewhere(mesh, path)
    if not mesh.areas_m2.sum() > 0:
        raise PointFileCorrupt(
            "no triangle that has an area",
            want="a surface",
            fix="Make the mesh again; points alone are shown as a cloud.",
            path=path,
        )
    return StillMesh(name, _fewer(_turned(mesh), name))


def surface_colours(still: StillMesh, colouring: Colouring) -> UInt8:
    """(V, 3) RGB of the vertices: a photo as it is, all else with light and shade.

    Args:
        still: the surface.
        colouring: what their colours mean.
    """
    colours = colouring.colours(still.points)
    if colouring.by == "photo" and still.mesh.rgb is not None:
        return colours
    return np.asarray(np.rint(colours * still.shade[:, None]), np.uint8)


def _somewhere(mesh: Mesh, path: Path) -> Mesh:
    """Without triangles at places that are none on Earth."""
    near = np.asarray((np.abs(mesh.vertices) < FARTHEST_M).all(axis=1))
    if near.all():
        return mesh
    kept = np.asarray(near[mesh.triangles].all(axis=1))
    _log.warning(
        "%s: %s triangles left out, farther than the Earth is large", path, f"{(~kept).sum():,}"
    )
    return mesh.only(kept)


def _turned(mesh: Mesh) -> Mesh:
    turned = turned_forward(PointCloud(mesh.vertices, mesh.frame))
    return replace(mesh, vertices=turned.xyz, frame=turned.frame, normals=None)


def _fewer(mesh: Mesh, name: str) -> Mesh:
    if len(mesh) <= MOST_TRIANGLES:
        return mesh
    _log.warning(
        "%s: %s triangles, of which %s are merged; this takes a while",
        name, f"{len(mesh):,}", f"{len(mesh) - MOST_TRIANGLES:,}",
    )  # fmt: skip
    origin: Float64 = mesh.vertices[0].astype(np.float64)  # far from 0 merging loses its digits
    few = decimated(replace(mesh, vertices=mesh.vertices - origin), MOST_TRIANGLES)
    return replace(few, vertices=few.vertices + origin, normals=None)
