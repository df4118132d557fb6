"""A drive of any length put into a map: run as a program, it tells its memory's peaks, MiB."""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pseudolidar.mapping import tiles as tiles_module
from pseudolidar.mapping.map_points import FramePoints
from pseudolidar.mapping.tiles import MapTiles

POINTS, STEP_M, MOST_WAITING = 4000, 2.0, 50_000


def peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def frames(count: int) -> Iterator[tuple[FramePoints, np.ndarray]]:
    """Frames that see a road of which each shows the most for the first time."""
    rng = np.random.default_rng(0)
    for i in range(count):
        xyz = rng.uniform((-10, -2, 2), (10, 2, 12), (POINTS, 3)).astype(np.float32)
        normals, rgb = np.zeros((POINTS, 3), np.float32), np.zeros((POINTS, 3), np.uint8)
        T = np.eye(4)
        T[0, 3] = STEP_M * i
        yield FramePoints(xyz, normals, rgb, np.full(POINTS, 0.05, np.float32)), T


def main(folder: Path, count: int) -> list[float]:
    """Peaks after a fifth of the frames, after all, and after all tiles were merged."""
    tiles_module.MOST_WAITING = MOST_WAITING
    store, peaks = MapTiles(views=1).start(folder), []
    for i, (points, T) in enumerate(frames(count)):
        store.add(points, T)
        if i == count // 5:
            peaks.append(peak_mib())
    peaks.append(peak_mib())
    points = sum(len(cloud) for _, cloud in store.merged())
    return [*peaks, peak_mib(), points]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(main(Path(sys.argv[1]), int(sys.argv[2]))))
