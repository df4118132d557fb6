"""What is exactly known of a street's surfaces and of the room that its cars drove through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.twists import inverted
from pseudolidar.sources.synthetic import SyntheticSource
from pseudolidar.sources.worlds.scene import Scene, scene_at
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.frame import StereoFrame

# What was seen nearer than this is to be in a map, m: of every so many pixels, in cubes of this
# edge, m.
SEEN_M, EVERY_PX, CUBE_M = 12.0, 3, 0.1
COMPLETE_M = 0.1
# Trails begin so high above the road, m: below are its own points.
ABOVE_ROAD_M = 0.3
# What moves is larger than its box by this, m.
AROUND_M = 0.2
FARTHEST_M = 5.0


@dataclass(frozen=True, eq=False)
class StillSurface:
    """What stands still.

    Args:
        seen: (N, 3) points of it that were seen from near, in the map.
        scenes: with triangles, one for each region of the world that the path is in.
        T_world_map: (4, 4).
    """

    seen: Float64
    scenes: tuple[Scene, ...]
    T_world_map: Float64

    @classmethod
    def of(cls, source: SyntheticSource, frames: list[StereoFrame]) -> StillSurface:
        seen = np.concatenate([_still_points(source, frame) for frame in frames])
        _, first = np.unique(np.floor(seen / CUBE_M).astype(np.int64), axis=0, return_index=True)
        world, rate_hz = source.world, source.settings.rate_hz
        scenes = {world.region(f.index / rate_hz): f.index / rate_hz for f in frames}
        return cls(
            seen[first],
            tuple(scene_at(world, t_s) for t_s in scenes.values()),
            world.T_world_base(0.0),
        )

    def distance_m(self, xyz: Float64) -> Float64:
        """(N,) distance of points of the map to the nearest triangle of what stands still."""
        from pseudolidar.geometry.open3d_library import load_open3d

        open3d = load_open3d()
        world = xyz @ self.T_world_map[:3, :3].T + self.T_world_map[:3, 3]
        nearest = np.full(len(xyz), FARTHEST_M)
        for scene in self.scenes:
            points = open3d.core.Tensor(np.float32(world - scene.origin_m))
            distance = scene.fixed.tree.compute_distance(points, nthreads=1).numpy()
            nearest = np.minimum(nearest, distance)
        return nearest


def _still_points(source: SyntheticSource, frame: StereoFrame) -> Float64:
    rig = frame.rig
    depth = np.asarray(rig.fB_px_m / (frame.truth.values[::EVERY_PX, ::EVERY_PX] + rig.doffs_px))
    row, column = np.nonzero(depth < SEEN_M)
    z = depth[row, column].astype(np.float64)
    K = rig.left.K
    x = (EVERY_PX * column - K[0, 2]) / K[0, 0] * z
    y = (EVERY_PX * row - K[1, 2]) / K[1, 1] * z
    T = frame.pose.matrix @ left_in_base_link(rig).matrix
    points = np.stack([x, y, z], axis=1) @ T[:3, :3].T + T[:3, 3]
    return points[~_in_boxes(source, points, frame.index, -AROUND_M)]


def in_driven_boxes(source: SyntheticSource, xyz: Float64) -> Bool:
    """(N,) whether points of the map lie where, at any time, something was that moved."""
    found = np.zeros(len(xyz), np.bool_)
    for index in range(source.settings.frames):
        found |= _in_boxes(source, xyz, index, ABOVE_ROAD_M)
    return found


def _in_boxes(source: SyntheticSource, xyz: Float64, index: int, above_m: float) -> Bool:
    """Whether points lie in what moves at the time of a frame, so far above its lower side."""
    T_map_world = inverted(source.world.T_world_base(0.0))
    found = np.zeros(len(xyz), np.bool_)
    for actor in source.world.actors(index / source.settings.rate_hz):
        T_box = inverted(T_map_world @ actor.thing.T_world_box)
        at = xyz @ T_box[:3, :3].T + T_box[:3, 3]
        half = np.array(actor.thing.size_m) / 2
        inside = (np.abs(at) < half + (AROUND_M if above_m < 0 else 0.0)).all(axis=1)
        found |= inside & (at[:, 2] > above_m - half[2])
    return found


def share_near(seen: Float64, xyz: Float64) -> float:
    """Share of points that have one of the map near."""
    distance, _ = cKDTree(xyz).query(seen, distance_upper_bound=COMPLETE_M)
    return float(np.isfinite(distance).mean())
