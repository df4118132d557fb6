"""Pictures of a scene: one exact ray a pixel centre, more where edges cross a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds.scene import Scene
from pseudolidar.structures.arrays import Bool, Float32, Float64, Int64
from pseudolidar.structures.camera import Camera

# Rays through a pixel that an edge crosses: a rotated grid, offsets from the centre, px.
EDGE_SAMPLES_PX = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
# Cosine between the normals of neighbours below which there is an edge.
EDGE_COSINE = 0.5
# Rays that are worked on together.
STRIP = 1 << 15


@dataclass(frozen=True, eq=False)
class View:
    """What one eye sees, before its sensor.

    Args:
        light: (H, W, 3) float32 linear light.
        depth: (H, W) float64 Z of the pixel centre, metres; NaN for the sky.
        objects: (H, W) int64 object number at the pixel centre, 0 for none.
    """

    light: Float32
    depth: Float64
    objects: Int64


@dataclass(frozen=True, eq=False)
class Seen:
    """What rays see: light (N, 3), depth (N,), normals (N, 3) of the triangles, triangles (N,)."""

    light: Float32
    depth: Float64
    facing: Float32
    prims: Int64


def render(scene: Scene, camera: Camera, T_world_camera: Float64) -> View:
    """See the scene through a pinhole camera.

    Depth and objects are those of the ray through the pixel's centre; light is averaged over the
    pixel where surfaces meet in it, and texture is filtered to the pixel's footprint everywhere.
    """
    eye = T_world_camera[:3, 3] - scene.origin_m
    M = T_world_camera[:3, :3] @ np.linalg.inv(camera.K)
    width, height = camera.size_px
    v, u = np.divmod(np.arange(width * height, dtype=np.float64), width)
    seen = _look(scene, eye, M, u, v, 1.0)
    shape = (height, width)
    kinds = scene.kinds(seen.prims)
    looks = kinds[:, 0] + (kinds[:, 1] << 6) + (kinds[:, 2] << 38)
    edges = np.flatnonzero(_edges(seen.facing.reshape(*shape, 3), looks.reshape(shape)))
    light = seen.light
    fine = np.zeros((len(edges), 3), np.float32)
    for du, dv in EDGE_SAMPLES_PX:
        fine += _look(scene, eye, M, u[edges] + du, v[edges] + dv, 0.5).light
    light[edges] = fine / len(EDGE_SAMPLES_PX)
    return View(
        light.reshape(*shape, 3), seen.depth.reshape(shape), kinds[:, 2].reshape(shape).copy()
    )


def _look(scene: Scene, eye: Float64, M: Float64, u: Float64, v: Float64, pixel: float) -> Seen:
    """See at pixel coordinates, strip by strip: what is in the cache need not be fetched."""
    n = len(u)
    whole = Seen(
        np.empty((n, 3), np.float32), np.empty(n), np.empty((n, 3), np.float32),
        np.empty(n, np.int64),
    )  # fmt: skip
    for start in range(0, n, STRIP):
        at = slice(start, start + STRIP)
        seen = _strip(scene, eye, M, u[at], v[at], pixel)
        whole.light[at], whole.depth[at] = seen.light, seen.depth
        whole.facing[at], whole.prims[at] = seen.facing, seen.prims
    return whole


def _strip(scene: Scene, eye: Float64, M: Float64, u: Float64, v: Float64, pixel: float) -> Seen:
    from pseudolidar.sources.worlds import shading

    directions = shading.pixel_directions(M, u, v)
    prims = scene.hit(eye, directions)
    fixed, moving = scene.fixed, scene.moving
    depth, points, colour, normals, facing = shading.shade(
        eye, directions, pixel * M[:, 0], pixel * M[:, 1], prims,
        fixed.rows, fixed.kind, moving.rows, moving.kind, scene.light.sky_seed,
    )  # fmt: skip
    light = scene.light_row()
    rays, which = shading.shadow_rays(points, facing, depth, light)
    lit = np.zeros(len(depth), bool)
    lit[which] = ~scene.shadowed(rays)
    shading.light_of(colour, normals, directions, depth, lit, points, light)
    return Seen(colour, depth, facing, prims)


def _edges(normals: Float32, looks: Int64) -> Bool:
    """(H, W) pixels beside another surface, on either side."""
    edges = np.zeros(looks.shape, bool)
    for a, b in (
        (np.s_[:-1, :], np.s_[1:, :]),
        (np.s_[:, :-1], np.s_[:, 1:]),
    ):
        cosine = np.einsum("ijk,ijk->ij", normals[a], normals[b])
        differ = (looks[a] != looks[b]) | ((cosine < EDGE_COSINE) & (looks[a] >= 0))
        edges[a] |= differ
        edges[b] |= differ
    return edges
