"""Octrees of large clouds: how long they take to build, what memory, what a view needs.

    python -m tests.benchmarks.octree [--points 20e6] [--views 50]

A town of flat ground and walls in UTM coordinates (float64), with colours and sigma, in no order.
The time of sorting the same number of codes with numpy, in the same run, is what to compare with.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.octree.chosen import Eye, chosen, needs_px, point_sizes_m
from pseudolidar.viewer.octree.stored import OctreeStore
from pseudolidar.viewer.octree.tree import Octree

UTM_M = np.array([4.5e5, 5.4e6, 110.0])
BUDGET = 2_000_000
HALF_M = 300.0


def town(count: int) -> PointCloud:
    """Half of it ground, half of it walls every 30 m."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform((-HALF_M, -HALF_M, 0), (HALF_M, HALF_M, 12), (count, 3))
    xyz[::2, 2] = rng.normal(0, 0.02, len(xyz[::2]))
    xyz[1::4, 0] = np.round(xyz[1::4, 0] / 30) * 30
    xyz[3::4, 1] = np.round(xyz[3::4, 1] / 30) * 30
    xyz += UTM_M
    rgb = rng.integers(0, 255, (count, 3), dtype=np.uint8)
    return PointCloud(xyz, "map", rgb=rgb, sigma_m=rng.random(count, np.float32))


def sorting_s(count: int) -> float:
    """Time that numpy takes to sort so many codes."""
    codes = np.random.default_rng(0).integers(0, 1 << 63, count, np.uint64)
    begun_s = time.perf_counter()
    codes.argsort()
    return time.perf_counter() - begun_s


def peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def choose(tree: Octree, views: int) -> None:
    rng = np.random.default_rng(1)
    times_s, points = [], []
    for _ in range(views):
        place = UTM_M + rng.uniform((-HALF_M, -HALF_M, 2), (HALF_M, HALF_M, 100))
        eye = Eye.of(
            wxyz=rng.normal(size=4),
            position_m=place,
            fov=1.3,
            width_px=1920,
            height_px=1080,
            T_map_scene=np.eye(4),
        )
        assert eye is not None
        begun_s = time.perf_counter()
        drawn = chosen(needs_px(tree, eye), tree.nodes["count"], BUDGET)
        point_sizes_m(tree, drawn)
        times_s.append(time.perf_counter() - begun_s)
        points.append(int(tree.nodes["count"][drawn].sum()))
    worst_ms, usual_ms = 1e3 * max(times_s), 1e3 * float(np.median(times_s))
    print(f"a view: {usual_ms:.1f} ms, at worst {worst_ms:.1f} ms; {max(points):,} points at most")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=float, default=20e6)
    parser.add_argument("--views", type=int, default=50)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        store = OctreeStore(Path(folder))
        store.build("warm", town(50_000))
        cloud = town(int(given.points))
        held_gb = sum(c.nbytes for c in (cloud.xyz, cloud.rgb, cloud.sigma_m) if c is not None)
        print(f"{len(cloud):,} points, {held_gb / 1e9:.2f} GB; peak so far {peak_gb():.2f} GB")
        sort_s = sorting_s(len(cloud))
        begun_s, begun_cpu_s = time.perf_counter(), time.process_time()
        tree = store.build("town", cloud)
        cpu_s = time.process_time() - begun_cpu_s
        wall_s = time.perf_counter() - begun_s
        print(
            f"built and kept: {wall_s:.1f} s, {cpu_s:.1f} s of one core, {wall_s / sort_s:.1f} x "
            f"the sorting of as many numbers; peak {peak_gb():.2f} GB"
        )
        begun_s = time.perf_counter()
        found = store.find("town")
        assert found is not None
        found.boxes_m  # noqa: B018 - made when it is first asked for
        print(f"found again: {time.perf_counter() - begun_s:.1f} s; {len(tree.nodes):,} nodes")
        choose(found, given.views)


if __name__ == "__main__":
    main()
