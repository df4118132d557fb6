"""A moment of a world made ready for rays: what they hit, and what lies in shadow."""

from __future__ import annotations

import functools
import threading
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pseudolidar.geometry.open3d_library import load_open3d
from pseudolidar.sources.worlds.meshes import join
from pseudolidar.sources.worlds.world import Light, Surroundings, Thing, World
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64, Int64

# Regions kept ready: the one the camera is in and the one it enters.
REGIONS_KEPT = 2
# One frame is one thread's work: frames run beside each other.
RAY_THREADS = 1
# A ray to a surface point ends this share before it, or it would meet the surface itself.
BEFORE = 1.0 - 1e-3

_building = threading.Lock()


@dataclass(frozen=True, eq=False)
class Solid:
    """Triangles in a ray-casting tree, relative to an origin."""

    rows: Float32
    kind: Int64
    tree: Any

    @classmethod
    def of(cls, rows: Float32, kind: Int64) -> Solid:
        """Build the tree and make it ready for any thread."""
        open3d = load_open3d()
        tree = open3d.t.geometry.RaycastingScene(nthreads=RAY_THREADS)
        if len(rows):
            # The tree sees the same single-precision corners that `shading.shade` computes with.
            first, edge_1, edge_2 = rows[:, 0:3], rows[:, 3:6], rows[:, 6:9]
            corners = np.stack([first, first + edge_1, first + edge_2], axis=1).reshape(-1, 3)
            faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
            tree.add_triangles(open3d.core.Tensor(corners), open3d.core.Tensor(faces))
            tree.cast_rays(_tensor(np.zeros((1, 6), np.float32)))  # builds it, once
        return cls(rows, kind, tree)

    def nearest(self, rays: Float32) -> tuple[Float32, Int64]:
        """(N,) distance in ray lengths (inf for none) and row of the nearest triangle."""
        if not len(self.rows):
            return np.full(len(rays), np.inf, np.float32), np.zeros(len(rays), np.int64)
        answer = self.tree.cast_rays(_tensor(rays), nthreads=RAY_THREADS)
        return answer["t_hit"].numpy(), answer["primitive_ids"].numpy().astype(np.int64)

    def blocks(self, rays: Float32, reach: float) -> Bool:
        """(N,) whether anything lies on the ray before `reach` ray lengths."""
        if not len(self.rows):
            return np.zeros(len(rays), bool)
        found = self.tree.test_occlusions(_tensor(rays), 0.0, reach, nthreads=RAY_THREADS)
        return np.asarray(found.numpy(), dtype=np.bool_)

    def of_object(self, number: int) -> Solid:
        """The triangles of one object."""
        mine = self._owned[self.kind[self._owned, 2] == number]
        return Solid.of(self.rows[mine], self.kind[mine])

    @functools.cached_property
    def _owned(self) -> Int64:
        """Rows that belong to any object."""
        return np.flatnonzero(self.kind[:, 2])


@dataclass(frozen=True, eq=False)
class Scene:
    """A world at one moment.

    Args:
        fixed: what stands still.
        moving: what moves, and thin things.
        casting: what moves: thin things throw no shadow.
        things: labelled objects of both.
        origin_m: (3,) world position that coordinates in here are relative to.
        light: light of the world.
    """

    fixed: Solid
    moving: Solid
    casting: Solid
    things: tuple[Thing, ...]
    origin_m: Float64
    light: Light

    def hit(self, origin: Float64, directions: Float64) -> Int64:
        """(N,) nearest triangle of each ray: row of fixed, then of moving; -1 for none."""
        from pseudolidar.sources.worlds.shading import single_rays

        rays = single_rays(origin, directions)
        near, prims = self.fixed.nearest(rays)
        nearer, others = self.moving.nearest(rays)
        prims = np.where(nearer < near, len(self.fixed.rows) + others, prims)
        return np.where(np.isfinite(np.minimum(near, nearer)), prims, -1)

    def alone(self, number: int, origin: Float64, directions: Float64) -> Bool:
        """(N,) whether rays would meet an object if it stood alone."""
        from pseudolidar.sources.worlds.shading import single_rays

        rays = single_rays(origin, directions)
        parts = (self.fixed.of_object(number), self.moving.of_object(number))
        return parts[0].blocks(rays, np.inf) | parts[1].blocks(rays, np.inf)

    def kinds(self, prims: Int64) -> Int64:
        """(N, 3) material, texture seed and object of triangles; -1, 0, 0 for none."""
        found = np.zeros((len(prims), 3), np.int64)
        border = len(self.fixed.rows)
        still, moves = (prims >= 0) & (prims < border), prims >= border
        found[still] = self.fixed.kind[prims[still]]
        found[moves] = self.moving.kind[prims[moves] - border]
        found[prims < 0, 0] = -1
        return found

    def light_row(self) -> Float64:
        """(14,) the light as `shading.light_of` takes it."""
        light, towards = self.light, np.array(self.light.towards)
        place = towards - self.origin_m if light.lamp else towards / np.linalg.norm(towards)
        row = (*place, light.lamp, *light.sun, *light.ambient, light.haze_m, *light.haze)
        return np.array(row, dtype=np.float64)

    def shadowed(self, rays: Float32) -> Bool:
        """(N,) whether something stands in the way of rays to the light."""
        reach = 0.98 if self.light.lamp else np.inf
        return self.fixed.blocks(rays, reach) | self.casting.blocks(rays, reach)

    def between(self, points: Float64, eye: Float64) -> Bool:
        """(N,) whether something stands between an eye (3,) and surface points (N, 3)."""
        rays = np.empty((len(points), 6), np.float32)
        rays[:, :3], rays[:, 3:] = eye, points - eye
        return self.fixed.blocks(rays, BEFORE) | self.moving.blocks(rays, BEFORE)


def scene_at(world: World, t_s: float) -> Scene:
    """The world at a time; static parts are built once a region and process."""
    solid, around = _region(world, world.region(t_s))
    actors = world.actors(t_s)
    moving = join([a.mesh.owned(a.thing.number) for a in actors])
    both = join([moving, around.thin])
    return Scene(
        solid,
        Solid.of(both.rows(around.origin_m), both.kind),
        Solid.of(moving.rows(around.origin_m), moving.kind),
        around.things + tuple(a.thing for a in actors),
        around.origin_m,
        world.light,
    )


def _region(world: World, number: int) -> tuple[Solid, Surroundings]:
    with _building:  # or every thread would build the same one
        return _built(world, number)


@functools.lru_cache(maxsize=REGIONS_KEPT)
def _built(world: World, number: int) -> tuple[Solid, Surroundings]:
    around = world.surroundings(number)
    rows = np.concatenate([mesh.rows(around.origin_m) for mesh in around.meshes])
    solid = Solid.of(rows, np.concatenate([mesh.kind for mesh in around.meshes]))
    return solid, replace(around, meshes=())


def _tensor(array: AnyArray) -> Any:
    return load_open3d().core.Tensor.from_numpy(np.ascontiguousarray(array))
