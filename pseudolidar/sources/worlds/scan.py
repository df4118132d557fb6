"""A Velodyne's turn in a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.beams import BeamTable
from pseudolidar.sources.worlds.scene import Scene
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.frame import LidarScan

# Width of a beam, radians (HDL-64E: 2 mrad of divergence): reflectance is averaged over it.
BEAM_RAD = 0.002


@dataclass(frozen=True)
class ScanNoise:
    """What a LiDAR gets wrong.

    Args:
        range_m: one standard deviation along the beam (HDL-64E: under 2 cm).
        lost: share of beams without an echo on white, near surfaces.
        lost_dark: share in addition on black surfaces at 50 m.
    """

    range_m: float = 0.02
    lost: float = 0.02
    lost_dark: float = 0.25


def scan(
    scene: Scene,
    T_world_velodyne: Float64,
    beams: BeamTable,
    noise: ScanNoise,
    *,
    timestamp_ns: int,
    rng: np.random.Generator,
) -> LidarScan:
    """Measure the scene in all directions of `beams` at one instant.

    Returns:
        Points in `velodyne`, with reflectance 0-1; the whole turn is taken at `timestamp_ns`.
    """
    from pseudolidar.sources.worlds.shading import shade

    R = T_world_velodyne[:3, :3]
    eye = T_world_velodyne[:3, 3] - scene.origin_m
    own = beams.directions()
    directions = own @ R.T
    prims = scene.hit(eye, directions)
    met = prims >= 0
    own, directions, prims = own[met], directions[met], prims[met]
    fixed, moving = scene.fixed, scene.moving
    step = np.array([0.0, 0.0, BEAM_RAD])
    depth, _, colour, _, facing = shade(
        eye, directions, step, step[[2, 2, 0]], prims,
        fixed.rows, fixed.kind, moving.rows, moving.kind, 0,
    )  # fmt: skip
    cosine = np.abs(np.einsum("ij,ij->i", facing, directions))
    reflectance = np.clip(colour.mean(axis=1) * (0.4 + 0.6 * cosine), 0.0, 1.0)
    kept = _echoes(depth, reflectance.astype(np.float64), beams, noise, rng)
    measured = depth + noise.range_m * rng.standard_normal(len(depth))
    xyz = (own * measured[:, None])[kept].astype(np.float32)
    return LidarScan(xyz, reflectance[kept].astype(np.float32), timestamp_ns)


def _echoes(
    range_m: Float64,
    reflectance: Float64,
    beams: BeamTable,
    noise: ScanNoise,
    rng: np.random.Generator,
) -> Bool:
    near, far = beams.range_m
    lost = noise.lost + noise.lost_dark * np.exp(-12.0 * reflectance) * (range_m / 50.0) ** 2
    kept = (rng.random(len(range_m)) >= lost) & (range_m > near) & (range_m < far)
    return np.asarray(kept, dtype=np.bool_)
