"""How crisp a map is, fused against unfused, and what cars that move leave in it.

    python -m tests.benchmarks.crisp [06] [0002] [street]

Every sequence is matched and followed once (`Fused`, the path settled); then the same disparities
are put together, as each frame measured them and as fusion along the path makes them.

Thickness (`evaluation/plane_thickness`) is the median over 0.4 m cubes of the points that lie
nearer than 15 m, one standard deviation, of level and of upright planes. `unfused` are points as
measured, `fused` those that three frames agree on, `fused, sure` what a map takes by default.
Trails are points of the map in boxes that cars and persons went through, 0.3 m above the road and
more. The surface is what frames really saw nearer than 12 m of all that stands still: complete is
the share of it that has a point of the map within 10 cm; accuracy is the distance of the map's
points to the exact triangles. Time is CPU time of one thread a frame, beside the matcher's.
Planes of 06 that are thicker than wanted are named, and end it with 1.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.evaluation.plane_thickness import plane_thickness
from pseudolidar.geometry.frames import MAP, left_in_base_link
from pseudolidar.mapping.free_space import FreeSpace
from pseudolidar.mapping.fusion import FusedFrame, TemporalFusion
from pseudolidar.mapping.map_points import FramePoints, MapPoints
from pseudolidar.mapping.odometry import Fused
from pseudolidar.mapping.tiles import MapTiles
from pseudolidar.running.mapped.build import colours_of
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.synthetic import Synthetic, SyntheticSource
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.filters.clean import Clean, Cleaner
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from tests.benchmarks.crisp_truth import StillSurface, in_driven_boxes, share_near
from tests.benchmarks.judging import Figure, end
from tests.conftest import DATA

STREET_FRAMES, SEEDS = 40, (0, 1)
JUDGED_M = 15.0
# Points of trails that are nearer to what stands still belong to that, m.
GHOST_M = 0.2
EVERYTHING = 1e6
# Thickness that is wanted of the map of 06, mm.
LEVEL_MM, UPRIGHT_MM = 8.0, 54.0


@dataclass(eq=False)
class Followed:
    """Frames with disparities and the path that odometry found.

    Args:
        frames: in order.
        disparities: of each, cleaned.
        rig: with the correction that motion told.
        T_map_camera: (N, 4, 4).
        match_ms: CPU time of matching, a frame.
    """

    frames: list[StereoFrame]
    disparities: list[DisparityMap]
    rig: StereoRig
    T_map_camera: Float64
    match_ms: float

    @classmethod
    def followed(cls, frames: list[StereoFrame]) -> Followed:
        match, clean = Census().load(), Cleaner.load(Clean())
        chain, disparities, match_ms = Fused().start(frames[0].rig), [], []
        for frame in frames:
            start = time.process_time()
            disparities.append(clean(frame, match(frame)).disparity)
            match_ms.append(1e3 * (time.process_time() - start))
            chain.register(frame, disparities[-1])
        (path,) = chain.trajectories()
        rig = frames[0].rig.with_correction(chain.correction or frames[0].rig.correction)
        T = left_in_base_link(rig).matrix @ path.T_world_body
        return cls(frames, disparities, rig, T, float(np.mean(match_ms[1:])))


@dataclass(eq=False)
class Put:
    """A sequence put together: fused frames, and what that took."""

    fused: list[FusedFrame]
    ms: float


def fused_along(sequence: Followed) -> Put:
    """Fusion along the path."""
    fusion, fused, ms = TemporalFusion().start(), [], []
    for disparity, T in zip(sequence.disparities, sequence.T_map_camera, strict=True):
        start = time.process_time()
        fused.append(fusion.add(disparity, sequence.rig, T))
        ms.append(1e3 * (time.process_time() - start))
    return Put(fused, float(np.mean(ms[2:])))


def as_measured(sequence: Followed) -> Put:
    """Each frame by itself."""
    fused = [
        TemporalFusion().start().add(disparity, sequence.rig, T)
        for disparity, T in zip(sequence.disparities, sequence.T_map_camera, strict=True)
    ]
    return Put(fused, 0.0)


@dataclass(frozen=True)
class Thickness:
    """Of planes, medians, mm.

    Args:
        level: of the ground.
        upright: of walls.
        counts: cubes that each is of.
    """

    level: float
    upright: float
    counts: str

    def line(self, name: str) -> str:
        """A line of the table."""
        return (
            f"  {name:30s} ground {self.level:5.1f} mm, upright {self.upright:5.1f} mm, "
            f"cubes {self.counts}"
        )

    def figures(self, row: str) -> list[Figure]:
        """What is judged."""
        both = (("ground", self.level, LEVEL_MM), ("upright", self.upright, UPRIGHT_MM))
        return [Figure(f"{row}: {what}", mm, most, form="{:.1f} mm") for what, mm, most in both]


def thickness(sequence: Followed, put: Put, choice: MapPoints) -> Thickness:
    """Of the planes of a sequence that was put together."""
    places, numbers = [], []
    for i, (frame, fused) in enumerate(zip(sequence.frames, put.fused, strict=True)):
        points = choice.of(fused, colours_of(frame))
        near = points.xyz[:, 2] < JUDGED_M
        places.append(points.in_map(sequence.T_map_camera[i])[0][near])
        numbers.append(np.full(int(near.sum()), i))
    planes = plane_thickness(np.concatenate(places), np.concatenate(numbers))
    ground, upright = (1e3 * planes.median_m(ground=level) for level in (True, False))
    counts = f"{planes.count(ground=True)}/{planes.count(ground=False)}"
    return Thickness(ground, upright, counts)


def mapped(sequence: Followed, put: Put, points: MapPoints, tiles: MapTiles) -> tuple[Float64, str]:
    """(N, 3) points of the whole map, and what the steps took."""
    with tempfile.TemporaryDirectory() as folder:
        store = tiles.start(Path(folder), MAP)
        free = FreeSpace(Path(folder) / "free_space", sequence.rig)
        begun = [time.process_time()]
        chosen: list[FramePoints] = []
        for frame, fused in zip(sequence.frames, put.fused, strict=True):
            chosen.append(points.of(fused, colours_of(frame)))
        begun.append(time.process_time())
        for one, T in zip(chosen, sequence.T_map_camera, strict=True):
            store.add(one, T)
        begun.append(time.process_time())
        for fused, T in zip(put.fused, sequence.T_map_camera, strict=True):
            free.add(fused.depth_m, T)
        begun.append(time.process_time())
        clouds = [cloud.xyz for _, cloud in store.merged(free)]
        begun.append(time.process_time())
        free.close()
    ms = 1e3 * np.diff(begun) / len(sequence.frames)
    took = ", ".join(
        f"{name} {one:.0f}"
        for name, one in zip(("points", "voxels", "depths", "merge and carve"), ms, strict=True)
    )
    return np.concatenate(clouds).astype(np.float64), took


def crisp(title: str, frames: list[StereoFrame]) -> tuple[Followed, Thickness]:
    """Thickness and times of a sequence, which are printed; and the thickness of its map."""
    sequence = Followed.followed(frames)
    say(f"{title}: {len(frames)} frames")
    fused, raw = fused_along(sequence), as_measured(sequence)
    every = MapPoints(frames=1, sigma=EVERYTHING)
    say(thickness(sequence, raw, every).line("unfused"))
    say(thickness(sequence, fused, MapPoints(sigma=EVERYTHING)).line("fused"))
    of_map = thickness(sequence, fused, MapPoints())
    say(of_map.line("fused, sure"))
    xyz, took = mapped(sequence, fused, MapPoints(), MapTiles())
    say(
        f"  map: {len(xyz)} points; a frame: matching {sequence.match_ms:.0f} ms, "
        f"fusion {fused.ms:.1f}, {took}"
    )
    return sequence, of_map


def street(seed: int) -> None:
    """A street with cars, against what is exactly known of it."""
    source = Synthetic("street", frames=STREET_FRAMES, seed=seed).open()
    sequence, _ = crisp(f"street {seed}", [source.load(i) for i in range(STREET_FRAMES)])
    surface = StillSurface.of(source, sequence.frames)
    fused, raw = fused_along(sequence), as_measured(sequence)
    cases: Sequence[tuple[str, Put, MapPoints, MapTiles]] = (
        ("unfused", raw, MapPoints(frames=1), MapTiles(views=1, carve=False)),
        ("fused, not carved", fused, MapPoints(), MapTiles(carve=False)),
        ("the map", fused, MapPoints(), MapTiles()),
    )
    for name, put, points, tiles in cases:
        xyz, _ = mapped(sequence, put, points, tiles)
        say("  " + street_row(name, source, surface, xyz))


def street_row(name: str, source: SyntheticSource, surface: StillSurface, xyz: Float64) -> str:
    """A line of the table."""
    trail = in_driven_boxes(source, xyz)
    distance_m = surface.distance_m(xyz)
    off_m, ghosts = distance_m[~trail], int((distance_m[trail] > GHOST_M).sum())
    complete = share_near(surface.seen, xyz)
    return (
        f"{name:20s} {len(xyz):7d} points, in trails {int(trail.sum()):5d}, {ghosts} of them "
        f"beyond 20 cm from all that stands still; "
        f"complete {complete:.1%}; off by {1e3 * np.median(off_m):.0f} mm (median), "
        f"{np.mean(off_m < 0.1):.1%} within 10 cm, {np.mean(off_m > 0.5):.2%} beyond 50 cm"
    )


def real(name: str) -> Iterator[StereoFrame]:
    """Frames of real data."""
    source = (
        KittiOdometry(str(DATA / "kitti_odometry")).open()
        if name == "06"
        else KittiRaw(str(DATA / "kitti_raw")).open()
    )
    return (source.load(i) for i in range(len(source.ids)))


def main(names: list[str]) -> None:
    """Print the tables; exit with 1 where they are not as wanted."""
    import cv2

    cv2.setNumThreads(1)
    figures = list[Figure]()
    for name in names or ["06", "0002", "street"]:
        if name == "street":
            for seed in SEEDS:
                street(seed)
        else:
            _, of_map = crisp(name, list(real(name)))
            figures += of_map.figures(name) if name == "06" else []
    end(figures)


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
