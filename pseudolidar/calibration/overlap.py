"""Where the pairs of a body stand to each other, from surfaces that two of them see: the input.

A sight is what one pair sees in one frame: few points, each with the surface that it lies on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pseudolidar.calibration.overlap_partners import Between, Partners
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

# Normals of one surface, seen by two pairs, agree to 35 degrees.
LEAST_COSINE = 0.8
# Roughness of surfaces and of the model, m: no point is surer than this.
FLOOR_M = 0.01


@dataclass(frozen=True)
class Overlap:
    """From surfaces that neighbouring pairs see: which points count.

    Args:
        most_m: points farther away are left out; stereo is coarse there.
        most_sigma_m: points with a larger error along the ray (68 %) are left out.
        voxel_m: edge of the cubes of which one point is kept.
        gates_m: how far apart points of one surface may be, step by step; the first must be larger
            than what the places given are wrong by, at the distance of the points.
        least_matches: points that must have a partner, of each pair, all frames together.
    """

    most_m: float = 30.0
    most_sigma_m: float = 1.2
    voxel_m: float = 0.2
    gates_m: tuple[float, ...] = (0.8, 0.4, 0.2, 0.12)
    least_matches: int = 300


@dataclass(frozen=True)
class Trust:
    """What is believed of the places given and of those found.

    Args:
        given_shift_m: how well the places given are known (68 %), m: what is seen overrules it,
            and directions that nothing is seen of stay near it.
        given_turn_deg: the same of their directions, degrees.
        worst_shift_m: largest standard deviation of a place's translation that is accepted.
        worst_turn_deg: of its rotation.
    """

    given_shift_m: float = 0.3
    given_turn_deg: float = 3.0
    worst_shift_m: float = 0.15
    worst_turn_deg: float = 0.7


@dataclass(frozen=True, eq=False)
class Sight:
    """What one pair sees in one frame, in its left camera's frame.

    Args:
        xyz: (N, 3) float64 m.
        normals: (N, 3) of length 1, to the camera's side.
        sigma_m: (N,) standard deviations along the rays.
    """

    xyz: Float64
    normals: Float64
    sigma_m: Float64

    @classmethod
    def of(cls, cloud: PointCloud, settings: Overlap) -> Sight:
        """Of a cloud in the left camera's frame: near, sure, on a surface, one of each cube.

        Args:
            cloud: with `sigma_m`; with `uv`, where its pixels are those of one picture.
            settings: which points count.
        """
        from pseudolidar.geometry.normals import normals_of_neighbours, normals_of_pixels
        from pseudolidar.geometry.voxels import best_of_voxel

        near = cloud.valid & (np.linalg.norm(cloud.xyz, axis=1) < settings.most_m)
        cloud = cloud[near]
        if cloud.uv is None:
            normals = normals_of_neighbours(cloud.xyz, np.zeros(3))
        else:
            camera = Pose.identity(cloud.frame, cloud.frame)
            normals = normals_of_pixels(cloud.xyz, cloud.uv, camera)
        sigma_m = np.zeros(len(cloud), np.float32) if cloud.sigma_m is None else cloud.sigma_m
        good = np.isfinite(normals).all(axis=1) & (sigma_m < settings.most_sigma_m)
        xyz, normals, sigma_m = cloud.xyz[good], normals[good], sigma_m[good]
        kept = best_of_voxel(xyz, sigma_m, voxel_m=settings.voxel_m)
        return cls(*(column[kept].astype(np.float64) for column in (xyz, normals, sigma_m)))

    def __len__(self) -> int:
        return len(self.xyz)

    @cached_property
    def tree(self) -> Any:
        """For nearest neighbours."""
        from scipy.spatial import cKDTree

        return cKDTree(self.xyz)

    @cached_property
    def rays(self) -> Float64:
        """(N, 3) directions from the camera, of length 1."""
        return np.asarray(self.xyz / np.linalg.norm(self.xyz, axis=1)[:, None], np.float64)

    def partners(self, other: Sight, between: Between, gate_m: float) -> Partners:
        """Points whose nearest point of the other sight is near and faces the same way.

        Args:
            other: what another pair sees in the same frame.
            between: the two pairs; this sight is of the first.
            gate_m: how far apart they may be.
        """
        T_body_other = between.T_body_second.matrix
        T_other_own = np.linalg.inv(T_body_other) @ between.T_body_first.matrix
        R_other_own, R_body_other = T_other_own[:3, :3], T_body_other[:3, :3]
        xyz = self.xyz @ R_other_own.T + T_other_own[:3, 3]
        distance_m, at = other.tree.query(xyz, distance_upper_bound=gate_m)
        near = np.flatnonzero(np.isfinite(distance_m))
        own_normals = self.normals[near] @ R_other_own.T
        alike = (own_normals * other.normals[at[near]]).sum(axis=1) > LEAST_COSINE
        mine, theirs = near[alike], at[near][alike]
        normals = other.normals[theirs]
        return Partners(
            between.first,
            between.second,
            xyz[mine] @ R_body_other.T + T_body_other[:3, 3],
            normals @ R_body_other.T,
            ((xyz[mine] - other.xyz[theirs]) * normals).sum(axis=1),
            ((self.rays[mine] @ R_other_own.T) * normals).sum(axis=1) * self.sigma_m[mine],
            (other.rays[theirs] * normals).sum(axis=1) * other.sigma_m[theirs],
            FLOOR_M,
        )
