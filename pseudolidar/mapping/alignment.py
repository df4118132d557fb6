"""Patches brought onto the surfaces of a map, with what is known of the motion beforehand.

KISS-ICP's own point to point ICP fails on clouds of stereo: points beyond the map's far edge match
that edge and pull the pose back. Planes slide along themselves instead, and what no plane holds is
left to the prior. Source of the estimator: maximum a posteriori, Gauss-Newton with Geman-McClure
weights as KISS-ICP has them (Vizzo et al., RA-L 2023), residuals point to plane (Chen & Medioni,
1992).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.twists import exp_twist, inverted, log_twist, rigid
from pseudolidar.mapping.patches import Patches
from pseudolidar.mapping.surface_map import Surfaces
from pseudolidar.structures.arrays import Float64, Int64, check_array

# What surfaces are off a plane besides the errors of matching, one standard deviation, m.
ROUGH_M = 0.03
# Residuals of more than so many sigmas hardly count.
KERNEL_SIGMA = 3.0
# Normals of one surface differ by less: cosine.
LEAST_COSINE = 0.8
# Patches share the errors of what they see: they are too sure by so much, in variance.
ALIKE = 30.0
MOST_ITERATIONS = 15
# Steps below this are the end: m, rad.
STILL_M, STILL_RAD = 2e-4, 2e-5
# A map without surfaces leaves directions open: an information that holds them, 1/m2 and 1/rad2.
HOLD = 1e-6


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of a pose before the map is looked at.

    Args:
        T_odom_sensor: (4, 4) the pose that is thought to be right.
        information: (6, 6) of a twist on its right, as `CameraStep` has it.
    """

    T_odom_sensor: Float64
    information: Float64

    def __post_init__(self) -> None:
        check_array("Prior", "T_odom_sensor", self.T_odom_sensor, (4, 4), np.float64)
        check_array("Prior", "information", self.information, (6, 6), np.float64)

    @classmethod
    def within(cls, T_odom_sensor: Float64, *, metres: float, rad: float) -> Prior:
        """A pose that is off by about so much in every direction."""
        return cls(T_odom_sensor, np.diag(np.repeat([metres**-2.0, rad**-2.0], 3)))


@dataclass(frozen=True, eq=False)
class Alignment:
    """A pose, and how well patches lie on the map there.

    Args:
        T_odom_sensor: (4, 4).
        information: (6, 6) what patches and prior know of it together.
        from_map: (6, 6) what patches alone know of it.
        score: mean agreement of all patches, 0-1; one without a surface counts 0.
        matched: share of patches that found a surface, 0-1.
        rms_sigma: of their residuals in sigmas, those that agree.
    """

    T_odom_sensor: Float64
    information: Float64
    from_map: Float64
    score: float
    matched: float
    rms_sigma: float


def align(
    patches: Patches,
    surfaces: Surfaces,
    prior: Prior,
    *,
    within_m: float,
    start: Float64 | None = None,
) -> Alignment:
    """The pose that patches and prior agree on.

    Args:
        patches: in the sensor's frame.
        surfaces: of the map.
        prior: the map can add to it, and seldom overrules it.
        within_m: surfaces farther from a patch are not its own.
        start: (4, 4) where to begin; the prior's pose by default.
    """
    T = prior.T_odom_sensor if start is None else start
    for _ in range(MOST_ITERATIONS):
        fit = _fit(patches, surfaces, T, within_m)
        known = fit.information + prior.information + HOLD * np.eye(6)
        wish = fit.wish + prior.information @ log_twist(inverted(T) @ prior.T_odom_sensor)
        step = np.linalg.solve(known, wish)
        T = np.asarray(T @ exp_twist(np.asarray(step)))
        if np.linalg.norm(step[:3]) < STILL_M and np.linalg.norm(step[3:]) < STILL_RAD:
            break
    # Rounding errors of a pose double with every frame of a chain that takes them for rigid.
    return lying_at(patches, surfaces, Prior(rigid(T), prior.information), within_m=within_m)


def lying_at(patches: Patches, surfaces: Surfaces, prior: Prior, *, within_m: float) -> Alignment:
    """How well patches lie on the map at the prior's pose, as it is."""
    fit = _fit(patches, surfaces, prior.T_odom_sensor, within_m)
    n = max(len(patches), 1)
    agreeing = fit.residual_sigma[np.abs(fit.residual_sigma) < KERNEL_SIGMA]
    return Alignment(
        prior.T_odom_sensor,
        fit.information + prior.information,
        fit.information,
        float((1.0 / (1.0 + (fit.residual_sigma / KERNEL_SIGMA) ** 2)).sum() / n),
        len(fit.residual_sigma) / n,
        float(np.sqrt((agreeing**2).mean())) if len(agreeing) else float("nan"),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Normal equations of patches at one pose."""

    information: Float64
    wish: Float64
    residual_sigma: Float64


def _fit(patches: Patches, surfaces: Surfaces, T: Float64, within_m: float) -> _Fit:
    R = np.ascontiguousarray(T[:3, :3])
    at = _mapped(patches.xyz, R) + T[:3, 3]
    index, found = surfaces.nearest(at, within_m)
    chosen = np.flatnonzero(found)
    normals = _mapped(patches.normals[chosen], R)
    of_map = surfaces.normals(index[chosen])
    cosine = np.einsum("ij,ij->i", normals, of_map)
    alike = np.abs(cosine) > LEAST_COSINE  # NaN is not
    chosen = chosen[alike]
    between = normals[alike] + np.sign(cosine[alike])[:, None] * of_map[alike]
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    return _equations(patches, chosen, at[chosen] - surfaces.xyz[index[chosen]], between, R)


def _equations(
    patches: Patches, chosen: Int64, apart: Float64, normals: Float64, R: Float64
) -> _Fit:
    """Source: the derivative of n . (T exp(xi) p - q) by xi at 0."""
    residual = np.einsum("ij,ij->i", normals, apart)
    # The map's points are as unsure as patches that are as far away.
    sigma = np.sqrt(ROUGH_M**2 + 2.0 * patches.sigma_m[chosen] ** 2)
    in_sigma = residual / sigma
    weight = 1.0 / (1.0 + (in_sigma / KERNEL_SIGMA) ** 2) ** 2 / (ALIKE * sigma**2)
    seen = _mapped(normals, R.T)
    J = np.concatenate([seen, np.cross(patches.xyz[chosen], seen)], axis=1)
    weighted = J * weight[:, None]
    # Sums without BLAS, which rounds by its number of threads.
    return _Fit(
        np.einsum("ni,nj->ij", weighted, J), -np.einsum("ni,n->i", weighted, residual), in_sigma
    )


def _mapped(vectors: Float64, R: Float64) -> Float64:
    """(N, 3) vectors turned by R, without BLAS."""
    return np.asarray(np.einsum("ij,nj->ni", R, vectors))
