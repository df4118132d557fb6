"""A residential street: houses, pavements, parked and moving cars, trees, poles, people."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds import objects
from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import Mesh, above, body_pose, frustum, join, turn_z
from pseudolidar.sources.worlds.road import Road
from pseudolidar.sources.worlds.street_ground import (
    CROSSING_AT_M,
    CROSSING_EVERY_M,
    KERB_HEIGHT_M,
    PIECE_M,
    WALK_EDGE_M,
    ground,
    in_side_street,
)
from pseudolidar.sources.worlds.traffic import Traffic, car_thing
from pseudolidar.sources.worlds.world import Actor, Light, RigDesign, Surroundings, Thing
from pseudolidar.structures.arrays import Float64

# Pieces that are made: behind the camera, and ahead of it.
PIECES_BEHIND, PIECES_AHEAD = 2, 8
# Left of the middle, or on either side of it, metres: lanes, parked cars, lamps, signs and poles
# at the kerb, trees, people, fronts of the houses, a second row of them.
LANE_M, PARKED_M, POST_M, TREE_M, WALKERS_M = 1.75, 5.25, 6.65, 7.1, 8.4
HOUSE_LINE_M, SECOND_ROW_M = 12.0, 34.5
# Utility poles stand here, metres left of the middle.
POLES_M = -9.6
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
            thin=join([_wires(self, k) for k in numbers]),
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
        parts.append(_houses(street, k, side, rng))
        parts.append(_green(street, k, side, rng))
        parts.append(_furniture(street, k, side, rng))
        cars = _parked(street, k, side, rng)
        parts += [mesh for mesh, _ in cars]
        things += [thing for _, thing in cars]
    return join(parts), tuple(things)


def _houses(street: Street, k: int, side: int, rng: np.random.Generator) -> Mesh:
    """A closed or loose row of fronts, and a second row behind it."""
    parts, end = [], (k + 1) * PIECE_M
    s = k * PIECE_M + rng.uniform(0.0, 2.0)
    while True:
        front, depth = rng.uniform(7.5, 12.5), rng.uniform(8.0, 11.0)
        gap = 0.0 if rng.random() < 0.35 else rng.uniform(1.5, 5.0)
        if s + front > end:
            break
        seed, storeys = int(rng.integers(1, 1 << 20)), int(rng.integers(2, 4))
        mesh = objects.house(rng, front_m=front, depth_m=depth, storeys=storeys, seed=seed)
        offset = HOUSE_LINE_M + rng.uniform(0, 1.5)
        if not in_side_street(k, s, s + front):
            parts.append(_beside(street.road, mesh, s, front, side, offset))
        s += front + gap
    seed = int(rng.integers(1, 1 << 20))
    mesh = objects.house(rng, front_m=16.0, depth_m=10.0, storeys=3, seed=seed)
    s = k * PIECE_M + rng.uniform(0, 12)
    if not in_side_street(k, s, s + 16.0):
        parts.append(_beside(street.road, mesh, s, 16.0, side, SECOND_ROW_M))
    return join(parts)


def _beside(road: Road, mesh: Mesh, s_m: float, front_m: float, side: int, n_m: float) -> Mesh:
    """Put a front that runs from x = 0 to `front_m` along the street, facing it."""
    middle, heading = road.place(s_m + 0.5 * front_m, side * n_m)
    # On the right the front's x axis points back along the street, or it would face away.
    yaw = heading if side > 0 else heading + np.pi
    start = middle - 0.5 * front_m * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return mesh.placed(above(start, 0.1), yaw_rad=yaw)


def _green(street: Street, k: int, side: int, rng: np.random.Generator) -> Mesh:
    """Street trees, hedges, shrubs, and taller trees behind the houses."""
    parts: list[Mesh] = []
    models, far_models = _trees(street.seed, 3), _trees(street.seed, 1)
    for s in np.arange(k * PIECE_M + 5.0, (k + 1) * PIECE_M, 11.0):
        s += rng.uniform(-1.5, 1.5)
        if rng.random() < 0.35 or in_side_street(k, s - 2.5, s + 2.5):
            continue
        place, _ = street.road.place(s, side * TREE_M)
        model = models[int(rng.integers(len(models)))]
        parts.append(
            model.placed(place, yaw_rad=rng.uniform(0, 6.28), scale=rng.uniform(0.75, 1.1))
        )
    for _ in range(4):
        s, n = k * PIECE_M + rng.uniform(0, PIECE_M), side * rng.uniform(24.0, 32.0)
        if in_side_street(k, s - 4.0, s + 4.0):
            continue
        place, _ = street.road.place(s, n)
        model = far_models[int(rng.integers(len(far_models)))]
        parts.append(model.placed(place, yaw_rad=rng.uniform(0, 6.28), scale=rng.uniform(1.2, 1.8)))
    parts.append(_hedges(street, k, side, rng))
    return join(parts)


def _hedges(street: Street, k: int, side: int, rng: np.random.Generator) -> Mesh:
    parts = []
    for s in np.arange(k * PIECE_M + 1.0, (k + 1) * PIECE_M - 4.0, 6.0):
        kind = rng.random()
        length = rng.uniform(3.5, 5.5)
        if in_side_street(k, s, s + length):
            continue
        place, heading = street.road.place(s + 0.5 * length, side * (WALK_EDGE_M + 0.5))
        half = 0.5 * length
        if kind < 0.3:
            hedge = frustum(
                (-half, -0.35, 0),
                (half, 0.35, rng.uniform(0.8, 1.4)),
                Material.LEAF,
                (0.07, 0.13, 0.045),
                inset=(0.1, 0.1, 0.08, 0.08),
                seed=int(rng.integers(1 << 20)),
            )
            parts.append(hedge.placed(above(place, 0.1), yaw_rad=heading))
        elif kind < 0.55:
            wall = frustum(
                (-half, -0.12, -0.3), (half, 0.12, 0.75), Material.BRICK, (0.33, 0.25, 0.2), seed=3
            )
            parts.append(wall.placed(above(place, 0.1), yaw_rad=heading))
        elif kind < 0.8:
            shrub = objects.bush(rng, radius_m=rng.uniform(0.5, 0.9))
            parts.append(shrub.placed(above(place, 0.1)))
    return join(parts)


def _furniture(street: Street, k: int, side: int, rng: np.random.Generator) -> Mesh:
    """Lamps and signs; on the right poles for wires."""
    parts: list[Mesh] = []
    place, heading = street.road.place(k * PIECE_M + 3.0, side * POST_M)
    parts.append(objects.lamp_post().placed(place, yaw_rad=heading + (np.pi if side > 0 else 0.0)))
    if rng.random() < 0.7:
        place, heading = street.road.place(k * PIECE_M + rng.uniform(8, 28), side * POST_M)
        parts.append(
            objects.sign_post(rng).placed(place, yaw_rad=heading + (np.pi if side > 0 else 0))
        )
    if side < 0:
        place, heading = street.road.place(k * PIECE_M + 16.0, POLES_M)
        parts.append(objects.utility_pole().placed(place, yaw_rad=heading))
    return join(parts)


def _wires(street: Street, k: int) -> Mesh:
    """From the pole of this piece to the next."""
    ends = [street.road.place(s, POLES_M) for s in ((k + 0.5) * PIECE_M, (k + 1.5) * PIECE_M)]
    return objects.wires(ends)


def _parked(
    street: Street, k: int, side: int, rng: np.random.Generator
) -> list[tuple[Mesh, Thing]]:
    """Cars at the kerb."""
    cars = []
    for slot in range(5):
        s = k * PIECE_M + 3.2 + 6.2 * slot + rng.uniform(-0.4, 0.4)
        colour = objects.CAR_COLOURS[int(rng.integers(len(objects.CAR_COLOURS)))]
        turned = rng.uniform(-0.03, 0.03)
        if rng.random() < 0.5 or in_side_street(k, s - 4.0, s + 4.0):
            continue
        place, heading = street.road.place(s, side * PARKED_M)
        T = turn_z(heading + turned + (np.pi if side > 0 else 0.0), above(place, -0.04))
        number = 1_000_000 + 10 * (k + 10_000) + slot + (5 if side > 0 else 0)
        cars.append((objects.car(colour).moved(T).owned(number), car_thing(number, T)))
    return cars


@functools.lru_cache(maxsize=4)
def _trees(seed: int, levels: int) -> tuple[Mesh, ...]:
    rng = np.random.default_rng([seed, 5])
    heights = rng.uniform(6.0, 8.5, 6)
    return tuple(objects.tree(rng, height_m=float(h), levels=levels) for h in heights)
