"""The similarity or rigid motion that best lays points onto points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64

# Points whose second direction spreads less than this share of the first lie on a line, about
# which they may be turned at will.
LINE_RATIO = 1e-6


@dataclass(frozen=True, eq=False)
class Similarity:
    """`p_dst = scale * R p_src + t`.

    Args:
        R: (3, 3) rotation.
        t_m: (3,) metres.
        scale: of the source's lengths.
        determined: whether the points say all of it; those on a line leave a turn open.
    """

    R: Float64
    t_m: Float64
    scale: float = 1.0
    determined: bool = True

    def poses(self, T_src_body: Float64) -> Float64:
        """(N, 4, 4) poses in the other frame: positions mapped, rotations turned, not scaled."""
        mapped = T_src_body.copy()
        mapped[:, :3, :3] = self.R @ T_src_body[:, :3, :3]
        mapped[:, :3, 3] = self.scale * (T_src_body[:, :3, 3] @ self.R.T) + self.t_m
        return mapped


def similarity_of(src: Float64, dst: Float64, *, scaled: bool) -> Similarity:
    """The least-squares fit of points (N, 3) to points (N, 3), row by row.

    Args:
        src: points that are mapped, metres.
        dst: where they shall lie, metres.
        scaled: whether lengths may change; else the motion is rigid.

    Source: Umeyama, Least-squares estimation of transformation parameters between two point
        patterns, PAMI 1991, equations 34-43.
    """
    src_mean, dst_mean = src.mean(axis=0), dst.mean(axis=0)
    from_mean, to_mean = src - src_mean, dst - dst_mean
    U, spread, Vt = np.linalg.svd(to_mean.T @ from_mean / len(src))
    mirror = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = (U * mirror) @ Vt
    variance = float((from_mean**2).sum() / len(src))
    scale = float(spread @ mirror) / variance if scaled and variance > 0 else 1.0
    determined = bool(spread[1] > LINE_RATIO * spread[0])
    return Similarity(R, dst_mean - scale * R @ src_mean, scale, determined)


def turn_sigma_rad(laid: Float64, dst: Float64) -> float:
    """How unsure the turn about the line is that points (N, 3) m lie near, laid onto others.

    What they are off across that line, by how far they lie from it. Errors of a path drift: they
    are taken to be one error, not N, which many points would make small. Infinite where all lie on
    the line.

    Args:
        laid: points after the fit.
        dst: where they should lie.
    """
    from_mean = laid - laid.mean(axis=0)
    line = np.linalg.svd(from_mean.T @ from_mean)[2][0]
    across = np.eye(3) - np.outer(line, line)
    apart_m2 = float(((from_mean @ across) ** 2).sum(axis=1).mean())
    off_m2 = float((((laid - dst) @ across) ** 2).sum(axis=1).mean())
    # Across are two directions; one of them turns.
    return float(np.sqrt(off_m2 / 2 / apart_m2)) if apart_m2 > 0 else np.inf
