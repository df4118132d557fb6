"""What frames saw through: where something was that is there no more, or never was."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping.fusion import NEAREST_M
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64
from pseudolidar.structures.camera import StereoRig

# Depths are kept for blocks of so many pixels, the nearest of each, where half of it is known.
BLOCK_PX, KNOWN_SHARE = 4, 0.5
# A place is at a surface within this, m, and so many sigmas of a disparity that is this sure, px.
MARGIN_M, MARGIN_SIGMAS, SIGMA_PX = 0.1, 3.0, 0.3
# Frames that were farther from a place than this say nothing of it, m.
REACH_M = 40.0
# What is seen through at least so often, and more often than it is seen, is not there.
LEAST_THROUGH = 2
MOST_DEPTH_M, STEPS_PER_M = 600.0, 100


class FreeSpace:
    """Depths of all frames, small, in a file: memory does not grow with the sequence.

    Args:
        path: of the file, which is made.
        rig: of all frames.
    """

    def __init__(self, path: Path, rig: StereoRig) -> None:
        self._file, self._path = path.open("wb"), path
        width, height = rig.left.size_px
        self._shape = height // BLOCK_PX, width // BLOCK_PX
        self._poses: list[Float64] = []
        K = rig.left.K
        middle = (BLOCK_PX - 1) / 2
        numbers = (*K[[0, 1], [0, 1]], *(K[:2, 2] - middle), BLOCK_PX * NEAREST_M)
        self._camera = (np.array(numbers) / BLOCK_PX).astype(np.float32)
        squared = MARGIN_SIGMAS * SIGMA_PX / rig.fB_px_m
        self._limits = np.array([MARGIN_M, squared], np.float32)

    def add(self, depth_m: Float32, T_map_camera: Float64) -> None:
        """A frame: (H, W) depth of its pixels, NaN where unknown, and where it was taken."""
        from pseudolidar.mapping.free_space_kernels import nearest_of_blocks

        blocks = np.empty(self._shape, np.float32)
        least = int(KNOWN_SHARE * BLOCK_PX**2)
        nearest_of_blocks(depth_m, BLOCK_PX, least, blocks)
        stored = np.rint(np.minimum(blocks, MOST_DEPTH_M) * STEPS_PER_M).astype("<u2")
        self._file.write(stored.tobytes())
        self._poses.append(T_map_camera)

    def empty(self, places: Float64) -> Bool:
        """(N,) whether frames see through places (N, 3) of one neighbourhood."""
        seen, through = self.counts(places)
        return np.asarray((through >= LEAST_THROUGH) & (through > seen))

    def counts(self, places: Float64) -> tuple[AnyArray, AnyArray]:
        """(N,) how often each of (N, 3) places is seen, and how often seen through."""
        from pseudolidar.mapping.free_space_kernels import look

        seen, through = np.zeros((2, len(places)), np.uint16)
        if not len(places) or not self._poses:
            return seen, through
        self._file.flush()
        depths = np.memmap(self._path, "<u2", "r", shape=(len(self._poses), *self._shape))
        origin = places.mean(axis=0)
        near = np.ascontiguousarray(places - origin, np.float32)
        reach_m = REACH_M + float(np.linalg.norm(near, axis=1).max())
        for stored, T_map_camera in zip(depths, self._poses, strict=True):
            if np.linalg.norm(T_map_camera[:3, 3] - origin) > reach_m:
                continue
            T = T_map_camera.copy()
            T[:3, 3] -= origin
            T_camera_map = np.ascontiguousarray(inverted(T)[:3], np.float32)
            depth = stored.astype(np.float32) / np.float32(STEPS_PER_M)
            look(near, depth, T_camera_map, self._camera, self._limits, seen, through)
        return seen, through

    def close(self) -> None:
        """The file is closed; it stays."""
        self._file.close()
