"""Motions between poses, and their angles."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import Float64


def inverses(T: Float64) -> Float64:
    """(N, 4, 4) inverses of rigid transforms (N, 4, 4)."""
    found = np.tile(np.eye(4), (len(T), 1, 1))
    found[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    found[:, :3, 3] = -np.einsum("nij,nj->ni", found[:, :3, :3], T[:, :3, 3])
    return found


def motions(T_world_begin: Float64, T_world_end: Float64) -> Float64:
    """(N, 4, 4) `T_begin_end`."""
    return inverses(T_world_begin) @ T_world_end


def lengths(T: Float64) -> Float64:
    """(N,) norms of the translations, metres."""
    return np.asarray(np.linalg.norm(T[:, :3, 3], axis=1))


def angles_rad(T: Float64) -> Float64:
    """(N,) angles of the rotations, 0 to pi.

    By sine and cosine: the arc cosine of the trace alone has no digits left at small angles, and
    its value for a rotation of six digits is an angle that is not there.
    """
    R = T[:, :3, :3]
    axis = np.stack(
        (R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]), axis=1
    )
    sine = np.linalg.norm(axis, axis=1) / 2
    cosine = (np.trace(R, axis1=1, axis2=2) - 1) / 2
    return np.asarray(np.arctan2(sine, cosine))


def path_lengths(T_world_body: Float64) -> Float64:
    """(N,) metres gone since the first pose."""
    steps = np.linalg.norm(np.diff(T_world_body[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
