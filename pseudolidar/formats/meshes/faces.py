"""Faces of any number of corners as triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.errors import MeshIndex, PointFileCorrupt
from pseudolidar.structures.arrays import AnyArray


def fans(faces: Sequence[AnyArray]) -> AnyArray:
    """(T, 3) int32 triangles of faces, each group (N, corners); fewer than three make none."""
    triangles = [np.zeros((0, 3), np.int32)]
    for group in faces:
        for corner in range(1, group.shape[1] - 1):
            triangles.append(group[:, [0, corner, corner + 1]].astype(np.int32))
    return np.concatenate(triangles)


def check_places(vertices: AnyArray) -> None:
    """Raise `PointFileCorrupt` where a vertex (V, 3) is nowhere."""
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise PointFileCorrupt(
            f"{bad.size} vertices that are not finite",
            want="metres",
            fix="Make the mesh again, or save its points alone.",
            where=f"vertex {bad[0]}",
        )


def check_numbers(numbers: AnyArray, vertices: int) -> None:
    """Raise `MeshIndex` where a face names a vertex that is not there."""
    bad = np.flatnonzero(~((numbers >= 0) & (numbers < vertices)).reshape(len(numbers), -1).all(1))
    if bad.size:
        raise MeshIndex(
            f"a face of the vertices {' '.join(map(str, np.atleast_1d(numbers[bad[0]])[:8]))}",
            want=f"numbers from 0 to {vertices - 1}",
            where=f"face {bad[0]}",
        )
