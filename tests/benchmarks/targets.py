"""A flat target in the rendered room, measured at 0.4 to 12 m: the thesis' tables repeated.

    python -m tests.benchmarks.targets [SEEDS [box | colour]]     # 20 box

The rig is that of the thesis (7 cm baseline, 640x480), the target 13 cm wide and measured by
`obstacles`; medians over seeds of the room, the texture and the noise. In the room stands nothing
before it. With `box` it is a poster of many colours, found by its exact box in the picture; with
`colour` cloth of one hue, which nothing else in the room has, found by the detector of colours.
Errors of the thesis are beside.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pseudolidar.clouds.ground_fit import GroundFit
from pseudolidar.geometry.box_in_view import across_m
from pseudolidar.obstacles.colour import Colour
from pseudolidar.obstacles.hues import Hues
from pseudolidar.obstacles.measure import measured
from pseudolidar.obstacles.sight import Sight
from pseudolidar.running.matching import MatchFrame, Refining
from pseudolidar.running.sighting import SMALL_THINGS_KEPT, SightFrame
from pseudolidar.sources.synthetic import WORLDS, Synthetic
from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import frustum, turn_z
from pseudolidar.sources.worlds.room import SENSOR_HEIGHT_M, Room
from pseudolidar.sources.worlds.world import Actor, Thing
from pseudolidar.stereo.census import Census
from pseudolidar.structures.box import Detection
from pseudolidar.structures.obstacle import Obstacle

SEEDS, WIDTH_M, THICK_M = 20, 0.13, 0.01
RED, PURPLE = (0.55, 0.06, 0.05), (0.45, 0.05, 0.55)
HUE = Colour(Hues.parse("270-310"), least_pixels=6, opening=1)
PLACE, RATE_HZ, NEAREST_M = (-5.0, -2.4, SENSOR_HEIGHT_M), 10.0, 0.35
# True distances, and the thesis' errors of distance and width, m; of the first table (red object,
# uncalibrated, 10.6 cm) and of the last two (drawn box; red object 13 cm).
NEAR = {
    0.4: (0.005, 0.000), 0.5: (0.006, 0.001), 0.6: (0.002, 0.000), 0.7: (0.012, 0.001),
    0.8: (0.016, 0.001), 0.9: (0.011, 0.001), 1.0: (0.033, 0.003), 1.1: (0.066, 0.007),
    1.2: (0.085, 0.009), 1.3: (0.122, 0.010), 1.4: (0.130, 0.011), 1.5: (0.203, 0.015),
}  # fmt: skip
FAR = {
    1.0: (0.489, 0.000), 2.0: (0.035, 0.000), 3.0: (0.025, 0.001), 4.0: (0.010, 0.001),
    5.0: (0.014, 0.000), 6.0: (0.218, 0.024), 7.0: (0.311, 0.022), 8.0: (0.379, None),
    9.0: (0.730, None), 10.0: (0.991, None), 11.0: (2.152, None), 12.0: (3.240, None),
}  # fmt: skip
DISTANCES = (*NEAR, *(d for d in FAR if d not in NEAR))


@dataclass(frozen=True)
class TargetRoom(Room):
    """The room from one place, a target before the left camera: frame i shows `DISTANCES[i]`."""

    name: ClassVar[str] = "target"
    material: ClassVar[Material] = Material.POSTER
    colour: ClassVar[tuple[float, float, float]] = RED

    def T_world_base(self, t_s: float) -> np.ndarray:  # noqa: ARG002 - it stands
        """Looking along the hall."""
        return turn_z(0.0, PLACE)

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """The target alone."""
        T_base_left = self.design.T_left_velodyne.inverse().matrix
        distance_m = DISTANCES[round(t_s * RATE_HZ) % len(DISTANCES)]
        T = self.T_world_base(t_s) @ T_base_left
        # axes of a box: x away from the camera, y left, z up
        turned = T @ np.block(
            [[np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.zeros((3, 1))], [0, 0, 0, 1.0]]
        )
        turned[:3, 3] = (T @ [0.0, 0.0, distance_m + 0.5 * THICK_M, 1.0])[:3]
        half = np.array([0.5 * THICK_M, 0.5 * WIDTH_M, 0.5 * WIDTH_M])
        mesh = (
            frustum(-half, half, self.material, self.colour, seed=self.seed).moved(turned).owned(1)
        )
        return (Actor(Thing(1, "target", turned, (THICK_M, WIDTH_M, WIDTH_M)), mesh),)


@dataclass(frozen=True)
class HuedRoom(TargetRoom):
    """The same with a target of one hue."""

    name: ClassVar[str] = "hued target"
    material: ClassVar[Material] = Material.CLOTH
    colour: ClassVar[tuple[float, float, float]] = PURPLE


def boxed(sight: Sight, distance_m: float) -> Detection:
    """The target's exact box."""
    K = sight.camera.K
    half_px = 0.5 * WIDTH_M * K[0, 0] / distance_m
    u, v = K[0, 2], K[1, 2]
    return Detection("region", (u - half_px, v - half_px, u + half_px, v + half_px))


def coloured(sight: Sight, distance_m: float) -> Detection | None:
    """What the detector of colours finds in the middle of the picture; None if nothing."""
    found = HUE.load()(sight)
    return found[0] if found else None


FINDERS = {"box": (TargetRoom, boxed), "colour": (HuedRoom, coloured)}


def measured_targets(
    seed: int, found_by: str = "box", distances: Sequence[float] = DISTANCES
) -> dict[float, Obstacle]:
    """The target at every distance at which it is found, in one room."""
    room, find = FINDERS[found_by]
    WORLDS[room.name] = room  # type: ignore[assignment]
    settings = Synthetic(room.name, frames=len(DISTANCES), seed=seed, rate_hz=RATE_HZ)
    source = settings.open()
    match = MatchFrame.load(source, Census(), Refining(), SMALL_THINGS_KEPT, min_depth_m=NEAREST_M)
    sighted = SightFrame.of(match, GroundFit())
    found: dict[float, Obstacle] = {}
    for distance_m in distances:
        frame = source.load(DISTANCES.index(distance_m))
        sight = replace(sighted(frame).sight, shared_px=0.0)
        detection = find(sight, distance_m)
        if detection is not None:
            (found[distance_m],) = measured(sight, [detection])
    return found


def main() -> None:
    """Print medians over seeds."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    found_by = sys.argv[2] if len(sys.argv) > 2 else "box"
    runs = [measured_targets(seed, found_by) for seed in range(seeds)]
    print("true m  patches  error m    %   width cm   within sigma   thesis: error m, width off cm")
    for table in (NEAR, FAR):
        for distance_m, (theirs_m, width_off) in table.items():
            known = [run[distance_m] for run in runs if distance_m in run]
            if not known:
                print(f"{distance_m:5.1f}   not found")
                continue
            off = float(np.median([abs(one.distance_m - distance_m) for one in known]))
            width = float(np.median([across_m(one.box) for one in known]))
            inside = np.mean(
                [abs(one.distance_m - distance_m) < one.sigma_distance_m for one in known]
            )
            theirs = "" if width_off is None else f" {100 * width_off:4.1f}"
            patches = sum(one.measured_by == "patch" for one in known)
            share = 100 * off / distance_m
            print(
                f"{distance_m:5.1f}   {patches:3d}/{len(known):<3d} {off:7.3f} {share:6.2f}"
                f"   {100 * width:6.2f}     {inside:4.0%}        {theirs_m:5.3f}{theirs}"
            )
        print()


if __name__ == "__main__":
    main()
