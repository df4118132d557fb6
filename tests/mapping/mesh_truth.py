"""Meshes against the surfaces that a rendered world really has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.open3d_library import load_open3d
from pseudolidar.sources.synthetic import SyntheticSource
from pseudolidar.sources.worlds.meshes import join
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.mesh import Mesh
from pseudolidar.structures.pose import Pose

POINTS = 20_000


@dataclass(frozen=True)
class SurfaceErrors:
    """How near a mesh and the true surface are to each other.

    Args:
        accurate: share of the mesh's area that lies within a distance of the true surface.
        complete: share of the true surface, as pixels saw it, that the mesh comes that near to.
        median_m: median distance of the mesh from the true surface.
    """

    accurate: dict[float, float]
    complete: dict[float, float]
    median_m: float


def left_pose(frame: StereoFrame) -> Pose:
    """`T_map_camera`, exact."""
    return frame.pose @ left_in_base_link(frame.rig)


def surface_errors(
    mesh: Mesh,
    source: SyntheticSource,
    frames: list[StereoFrame],
    *,
    within_m: tuple[float, ...] = (0.05, 0.1),
    max_depth_m: float,
) -> SurfaceErrors:
    """Distances of points of the mesh, drawn evenly, and of true points that the frames see."""
    to_truth = distances(on_surface(mesh), *true_triangles(source, frames))
    to_mesh = distances(seen_points(frames, max_depth_m), mesh.vertices, mesh.triangles)
    return SurfaceErrors(
        {m: float((to_truth < m).mean()) for m in within_m},
        {m: float((to_mesh < m).mean()) for m in within_m},
        float(np.median(to_truth)),
    )


def true_triangles(source: SyntheticSource, frames: list[StereoFrame]):
    """Vertices and triangles of all that stands still, and of what moves at each frame, in map."""
    world, rate_hz = source.world, source.settings.rate_hz
    meshes = {}
    for frame in frames:
        t_s = frame.index / rate_hz
        around = world.surroundings(world.region(t_s))
        meshes[world.region(t_s)] = join([*around.meshes, around.thin])
        meshes[f"actors {t_s}"] = join([actor.mesh for actor in world.actors(t_s)])
    corners = np.concatenate([m.corners for m in meshes.values()])
    T_map_world = np.linalg.inv(world.T_world_base(0.0))
    vertices = corners.reshape(-1, 3) @ T_map_world[:3, :3].T + T_map_world[:3, 3]
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def on_surface(mesh: Mesh) -> np.ndarray:
    """(POINTS, 3) evenly by area."""
    rng = np.random.default_rng(0)
    which = rng.choice(len(mesh), POINTS, p=mesh.areas_m2 / mesh.areas_m2.sum())
    a, b = np.sqrt(rng.random(POINTS)), rng.random(POINTS)
    share = np.stack([1 - a, a * (1 - b), a * b], axis=1)
    return (mesh.corners[which] * share[..., None]).sum(axis=1)


def seen_points(frames: list[StereoFrame], max_depth_m: float) -> np.ndarray:
    """(N, 3) true points of random pixels, in map."""
    rng, points = np.random.default_rng(1), []
    for frame in frames:
        depth_m, K = depth_map(frame.truth, frame.rig).values, frame.rig.left.K
        v, u = np.nonzero(depth_m < max_depth_m)
        chosen = rng.choice(len(v), min(POINTS // len(frames), len(v)), replace=False)
        v, u = v[chosen], u[chosen]
        z = depth_m[v, u].astype(np.float64)
        xyz = np.stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z], axis=1)
        points.append(left_pose(frame).apply(xyz))
    return np.concatenate(points)


def distances(points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(N,) metres to the nearest triangle."""
    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(triangles.astype(np.uint32))
    )
    return scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()
