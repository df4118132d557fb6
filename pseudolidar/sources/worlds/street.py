"""A residential street: houses, pavements, parked and moving cars, trees, poles, people."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds.meshes import Mesh, above, body_pose, join
from pseudolidar.sources.worlds.road import Road
from pseudolidar.sources.worlds.street_ground import (
    CROSSING_AT_M,
    CROSSING_EVERY_M,
    KERB_HEIGHT_M,
    PIECE_M,
    ground,
)
from pseudolidar.sources.worlds.street_sides import (
    furniture,
    green,
    houses,
    parked,
    second_row,
    wires,
)
from pseudolidar.sources.worlds.traffic import Traffic
from pseudolidar.sources.worlds.world import Actor, Light, RigDesign, Surroundings, Thing
from pseudolidar.structures.arrays import Float64

# Pieces that are made: behind the camera, and ahead of it.
PIECES_BEHIND, PIECES_AHEAD = 2, 8
# On either side of the middle, metres: lanes, and people.
LANE_M, WALKERS_M = 1.75, 8.4
# Height of the Velodyne over the road, metres (KITTI).
SENSOR_HEIGHT_M = 1.73


@dataclass(frozen=True)
class Street:
    """Drive along a street that never ends.

    Args:
        seed: which street.
        speed_m_s: speed of the car with the cameras.
    """

    seed: int = 0
    speed_m_s: float = 8.0

    @property
    def design(self) -> RigDesign:
        """KITTI's colour cameras: 1242 x 375, f 721.5 px, 0.54 m apart."""
        return RigDesign(
            width_px=1242,
            height_px=375,
            focal_px=721.5377,
            centre=(0.4912, 0.4623),
            baseline_m=0.54,
            left_in_base_m=(0.27, 0.06, -0.08),
            pitch_deg=0.4,
            yaw_deg=0.3,
        )

    @property
    def light(self) -> Light:
        """Afternoon sun from behind on the left."""
        return Light(
            (-0.45, 0.62, 0.75),
            (1.55, 1.42, 1.2),
            (0.42, 0.47, 0.55),
            haze_m=900.0,
            sky_seed=self.seed,
        )

    @property
    def road(self) -> Road:
        """Its centre line."""
        return Road(self.seed)

    @property
    def traffic(self) -> Traffic:
        """Who else is on the road."""
        return Traffic(
            self.seed,
            self.road,
            self.speed_m_s,
            side_streets_m=(CROSSING_AT_M, CROSSING_EVERY_M),
            lane_m=LANE_M,
            pavement_m=WALKERS_M,
            pavement_height_m=KERB_HEIGHT_M,
        )

    def T_world_base(self, t_s: float) -> Float64:
        """The Velodyne on a car in the right lane, with a little pitch, roll and bounce."""
        s = np.array([self.traffic.own_s(t_s)])
        spot, heading = self.road.place(float(s[0]), -LANE_M)
        pitch = -float(self.road.slope_rad(s)[0]) + 0.003 * np.sin(5.1 * t_s)
        roll = 0.004 * np.sin(3.3 * t_s + 1.0)
        lift = SENSOR_HEIGHT_M + 0.012 * np.sin(6.7 * t_s)
        place = above(spot, float(lift))
        return body_pose(place, yaw_rad=heading, pitch_rad=pitch, roll_rad=roll)

    def region(self, t_s: float) -> int:
        """Piece that the car is on."""
        return int(self.traffic.own_s(t_s) // PIECE_M)

    def surroundings(self, region: int) -> Surroundings:
        """Pieces behind and ahead."""
        numbers = range(region - PIECES_BEHIND, region + PIECES_AHEAD + 1)
        pieces = [_piece(self, k) for k in numbers]
        origin, _ = self.road.place(region * PIECE_M, 0.0)
        return Surroundings(
            meshes=tuple(mesh for mesh, _ in pieces),
            thin=join([wires(self, k) for k in numbers]),
            things=tuple(thing for _, things in pieces for thing in things),
            origin_m=np.round(origin),
        )

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """Cars and persons within sight."""
        return self.traffic.actors(t_s)


@functools.lru_cache(maxsize=PIECES_BEHIND + PIECES_AHEAD + 2)
def _piece(street: Street, k: int) -> tuple[Mesh, tuple[Thing, ...]]:
    rng = np.random.default_rng([street.seed, 1000, k + 1_000_000])
    parts = [ground(street.road, k)]
    things: list[Thing] = []
    for side in (1, -1):
        parts.append(houses(street, k, side, rng))
        parts.append(second_row(street, k, side, rng))
        parts.append(green(street, k, side, rng))
        parts.append(furniture(street, k, side, rng))
        cars = parked(street, k, side, rng)
        parts += [mesh for mesh, _ in cars]
        things += [thing for _, thing in cars]
    return join(parts), tuple(things)
