"""A flat target in the rendered room, measured at 0.4 to 12 m: the thesis' tables repeated.

    python -m tests.benchmarks.targets [SEEDS [box | colour]]     # 20 box

The rig is that of the thesis (7 cm baseline, 640x480), the target 13 cm wide and measured by
`obstacles`; medians over seeds of the room, the texture and the noise. In the room stands nothing
before it. With `box` it is a poster of many colours, found by its exact box in the picture; with
`colour` cloth of one hue, which nothing else in the room has, found by the detector of colours.
The thesis' errors and those that are wanted are beside; a row that does not hold ends it with 1.
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
from tests.benchmarks.judging import Figure, end

SEEDS, WIDTH_M, THICK_M = 20, 0.13, 0.01
# What is wanted: see `Row.wanted_m`; and of the width.
GOOD_SHARE, LAST_SHARE, WIDTH_SHARE = 0.01, 0.03, 0.03
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


@dataclass(frozen=True)
class Row:
    """Medians over seeds at one distance, beside what the thesis has and what is wanted.

    Args:
        distance_m: true distance.
        found: the target in each room in which it is found.
        theirs_m: the thesis' error of distance.
        theirs_width_m: the thesis' error of width; None where it has none.
    """

    distance_m: float
    found: tuple[Obstacle, ...]
    theirs_m: float
    theirs_width_m: float | None

    @property
    def off_m(self) -> float:
        """Our error of distance."""
        return float(np.median([abs(one.distance_m - self.distance_m) for one in self.found]))

    @property
    def wanted_m(self) -> float:
        """The thesis' error is beaten where it exceeds 1 %, else 1 % held; 3 % at the end."""
        if self.distance_m == max(FAR):
            return LAST_SHARE * self.distance_m
        return max(self.theirs_m, GOOD_SHARE * self.distance_m)

    @property
    def width_m(self) -> float:
        """Our width."""
        return float(np.median([across_m(one.box) for one in self.found]))

    @property
    def figures(self) -> tuple[Figure, ...]:
        """What is judged of it: errors of distance and width."""
        at = f"target at {self.distance_m:g} m"
        if not self.found:
            return (Figure(f"{at}: rooms in which it is found", 0, 1, least=True, form="{:.0f}"),)
        off_m = abs(self.width_m - WIDTH_M)
        return (
            Figure(f"{at}: error of distance", self.off_m, self.wanted_m, form="{:.3f} m"),
            Figure(f"{at}: error of width", off_m, WIDTH_SHARE * WIDTH_M, form="{:.4f} m"),
        )

    @property
    def holds(self) -> bool:
        """Whether distance and width are as wanted."""
        return all(one.holds for one in self.figures)

    def line(self) -> str:
        """As printed."""
        if not self.found:
            return f"{self.distance_m:5.1f}   not found   NOT HELD"
        inside = np.mean(
            [abs(one.distance_m - self.distance_m) < one.sigma_distance_m for one in self.found]
        )
        patches = sum(one.measured_by == "patch" for one in self.found)
        width_off = 100 * abs(self.width_m - WIDTH_M)
        judged = "" if self.holds else "NOT HELD"
        theirs = "-" if self.theirs_width_m is None else f"{100 * self.theirs_width_m:.1f}"
        return (
            f"{self.distance_m:5.1f}   {patches:3d}/{len(self.found):<3d} {self.off_m:7.3f} "
            f"{self.theirs_m:7.3f} {self.wanted_m:7.3f}   {width_off:6.2f} {theirs:>6} "
            f"{100 * WIDTH_SHARE * WIDTH_M:6.2f}   {inside:5.0%}   {judged}"
        )


HEADER = """\
               error of distance, m      of width, cm          within
true m patches    ours  thesis  wanted     ours thesis wanted   sigma"""


def tables(runs: Sequence[dict[float, Obstacle]]) -> list[list[Row]]:
    """The rows of both tables of the thesis."""
    return [
        [
            Row(d, tuple(run[d] for run in runs if d in run), theirs_m, theirs_width_m)
            for d, (theirs_m, theirs_width_m) in table.items()
        ]
        for table in (NEAR, FAR)
    ]


def main() -> None:
    """Print medians over seeds; exit with 1 where they are not as wanted."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    found_by = sys.argv[2] if len(sys.argv) > 2 else "box"
    made = tables([measured_targets(seed, found_by) for seed in range(seeds)])
    for rows in made:
        print("\n".join([HEADER, *(row.line() for row in rows), ""]))
    end(one for rows in made for row in rows for one in row.figures)


if __name__ == "__main__":
    main()
