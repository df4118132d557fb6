"""A residential street: houses, pavements, parked and moving cars, trees, poles, people."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds import objects
from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import Mesh, above, frustum, join, sheet, turn_z
from pseudolidar.sources.worlds.road import Road
from pseudolidar.sources.worlds.traffic import Traffic, car_thing
from pseudolidar.sources.worlds.world import Actor, Light, RigDesign, Surroundings, Thing
from pseudolidar.structures.arrays import Float64

# The street is made piece by piece.
PIECE_M = 32.0
PIECES_BEHIND, PIECES_AHEAD = 2, 8
# Every so many pieces a side street crosses, in the middle of the piece.
CROSSING_EVERY, CROSSING_AT = 5, 2
# Across the street, metres from its middle (left and right alike).
LANE_M, ROAD_EDGE_M, KERB_M, WALK_EDGE_M, HOUSE_LINE_M = 1.75, 5.6, 5.75, 9.2, 11.5
KERB_HEIGHT_M = 0.13
# Height of the Velodyne over the road, metres (KITTI).
SENSOR_HEIGHT_M = 1.73

GREY = (0.115, 0.115, 0.118)
STONE = (0.30, 0.29, 0.27)


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
        return Traffic(self.seed, self.road, self.speed_m_s)

    def T_world_base(self, t_s: float) -> Float64:
        """The Velodyne on a car in the right lane, with a little pitch, roll and bounce."""
        s = np.array([self.traffic.own_s(t_s)])
        ground, heading = self.road.place(float(s[0]), -LANE_M)
        pitch = -float(self.road.slope_rad(s)[0]) + 0.003 * np.sin(5.1 * t_s)
        roll = 0.004 * np.sin(3.3 * t_s + 1.0)
        lift = SENSOR_HEIGHT_M + 0.012 * np.sin(6.7 * t_s)
        cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
        T = turn_z(heading, above(ground, float(lift)))
        R_pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        R_roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        T[:3, :3] = T[:3, :3] @ R_pitch @ R_roll
        return T

    def region(self, t_s: float) -> int:
        """Piece that the car is on."""
        return int(self.traffic.own_s(t_s) // PIECE_M)

    def surroundings(self, region: int) -> Surroundings:
        """Pieces behind and ahead."""
        pieces = [_piece(self, k) for k in range(region - PIECES_BEHIND, region + PIECES_AHEAD + 1)]
        origin, _ = self.road.place(region * PIECE_M, 0.0)
        things = tuple(thing for _, things in pieces for thing in things)
        return Surroundings(join([mesh for mesh, _ in pieces]), things, np.round(origin))

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """Cars and persons within sight."""
        return self.traffic.actors(t_s)


def is_crossing(piece: int) -> bool:
    """Whether a side street crosses in the middle of the piece."""
    return piece % CROSSING_EVERY == CROSSING_AT


@functools.lru_cache(maxsize=2 * (PIECES_BEHIND + PIECES_AHEAD + 1))
def _piece(street: Street, k: int) -> tuple[Mesh, tuple[Thing, ...]]:
    rng = np.random.default_rng([street.seed, 1000, k + 1_000_000])
    parts = [_ground(street.road, k)]
    things: list[Thing] = []
    for side in (1, -1):
        parts.append(_houses(street, k, side, rng))
        parts.append(_green(street, k, side, rng))
        parts.append(_furniture(street, k, side, rng))
        cars = _parked(street, k, side, rng)
        parts += [mesh for mesh, _ in cars]
        things += [thing for _, thing in cars]
    return join(parts), tuple(things)


def _ground(road: Road, k: int) -> Mesh:
    """Strips along the street: road, kerbs, pavements, gardens, land behind."""
    s = np.linspace(k * PIECE_M, (k + 1) * PIECE_M, 17)

    def strip(
        n: tuple[float, ...], z: tuple[float, ...], material: Material, colour: object
    ) -> Mesh:
        S, N = np.meshgrid(s, np.array(n), indexing="ij")
        points = road.at(S.ravel(), N.ravel()).reshape(*S.shape, 3)
        points[..., 2] += np.array(z)
        texture = np.stack([S, N, np.broadcast_to(np.array(z), S.shape)], axis=-1)
        return sheet(points, material, colour, texture=texture, seed=1)  # type: ignore[arg-type]

    top = KERB_HEIGHT_M
    parts = [strip((-ROAD_EDGE_M, 0.0, ROAD_EDGE_M), (-0.05, 0.0, -0.05), Material.ASPHALT, GREY)]
    for side in (1.0, -1.0):
        edge, kerb, walk = side * ROAD_EDGE_M, side * KERB_M, side * WALK_EDGE_M
        far = (side * 14.0, side * 40.0, side * 150.0)
        if is_crossing(k):
            parts.append(
                strip((edge, walk, *far), (-0.05, 0.0, 0.2, 0.4, 2.0), Material.ASPHALT, GREY)
            )
            continue
        parts.append(strip((edge, edge, kerb), (-0.06, top, top), Material.PLAIN, STONE))
        parts.append(strip((kerb, walk), (top, top + 0.03), Material.PAVEMENT, (0.27, 0.26, 0.25)))
        parts.append(
            strip((walk, *far), (top + 0.03, 0.3, 0.5, 2.5), Material.GRASS, (0.09, 0.13, 0.045))
        )
    return join(parts)


def _houses(street: Street, k: int, side: int, rng: np.random.Generator) -> Mesh:
    """A closed or loose row of fronts, and a second row behind it."""
    if is_crossing(k):
        return join([])
    parts, s = [], k * PIECE_M + rng.uniform(0.0, 2.0)
    end = (k + 1) * PIECE_M
    while True:
        front, depth = rng.uniform(7.5, 12.5), rng.uniform(8.0, 11.0)
        gap = 0.0 if rng.random() < 0.35 else rng.uniform(1.5, 5.0)
        if s + front > end:
            break
        seed = int(rng.integers(1, 1 << 20))
        mesh = objects.house(
            rng, front_m=front, depth_m=depth, storeys=int(rng.integers(2, 4)), seed=seed
        )
        parts.append(_beside(street.road, mesh, s, front, side, HOUSE_LINE_M + rng.uniform(0, 1.5)))
        s += front + gap
    mesh = objects.house(
        rng, front_m=16.0, depth_m=10.0, storeys=3, seed=int(rng.integers(1, 1 << 20))
    )
    parts.append(_beside(street.road, mesh, k * PIECE_M + rng.uniform(0, 12), 16.0, side, 34.0))
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
        if is_crossing(k) or rng.random() < 0.35:
            continue
        place, _ = street.road.place(s + rng.uniform(-1.5, 1.5), side * 6.5)
        model = models[int(rng.integers(len(models)))]
        parts.append(
            model.placed(place, yaw_rad=rng.uniform(0, 6.28), scale=rng.uniform(0.75, 1.1))
        )
    for _ in range(4):
        place, _ = street.road.place(
            k * PIECE_M + rng.uniform(0, 32), side * rng.uniform(24.0, 32.0)
        )
        model = far_models[int(rng.integers(len(far_models)))]
        parts.append(model.placed(place, yaw_rad=rng.uniform(0, 6.28), scale=rng.uniform(1.2, 1.8)))
    if is_crossing(k):
        return join(parts)
    parts.append(_hedges(street, k, side, rng))
    return join(parts)


def _hedges(street: Street, k: int, side: int, rng: np.random.Generator) -> Mesh:
    parts = []
    for s in np.arange(k * PIECE_M + 1.0, (k + 1) * PIECE_M - 4.0, 6.0):
        kind = rng.random()
        length = rng.uniform(3.5, 5.5)
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
    """Lamps and signs; on the left poles with wires."""
    parts: list[Mesh] = []
    place, heading = street.road.place(k * PIECE_M + 3.0, side * 6.05)
    parts.append(objects.lamp_post().placed(place, yaw_rad=heading + (np.pi if side > 0 else 0.0)))
    if rng.random() < 0.7:
        place, heading = street.road.place(k * PIECE_M + rng.uniform(8, 28), side * 6.0)
        parts.append(
            objects.sign_post(rng).placed(place, yaw_rad=heading + (np.pi if side > 0 else 0))
        )
    if side < 0:
        ends = [street.road.place(s, -9.0) for s in (k * PIECE_M + 16.0, (k + 1) * PIECE_M + 16.0)]
        parts.append(objects.utility_pole().placed(ends[0][0], yaw_rad=ends[0][1]))
        for offset in (-0.7, 0.0, 0.7):
            from_to = [turn_z(yaw, place)[:3] @ (0.0, offset, 7.15, 1.0) for place, yaw in ends]
            parts.append(objects.wire(*from_to))
    return join(parts)


def _parked(
    street: Street, k: int, side: int, rng: np.random.Generator
) -> list[tuple[Mesh, Thing]]:
    """Cars at the kerb."""
    cars = []
    for slot in range(5):
        s = k * PIECE_M + 3.2 + 6.2 * slot + rng.uniform(-0.4, 0.4)
        colour = objects.CAR_COLOURS[int(rng.integers(len(objects.CAR_COLOURS)))]
        turned = rng.uniform(-0.03, 0.03)
        if rng.random() < 0.5 or is_crossing(k):
            continue
        place, heading = street.road.place(s, side * 4.62)
        T = turn_z(heading + turned + (np.pi if side > 0 else 0.0), above(place, -0.04))
        number = 1_000_000 + 10 * (k + 10_000) + slot + (5 if side > 0 else 0)
        cars.append((objects.car(colour).moved(T).owned(number), car_thing(number, T)))
    return cars


@functools.lru_cache(maxsize=4)
def _trees(seed: int, levels: int) -> tuple[Mesh, ...]:
    rng = np.random.default_rng([seed, 5])
    heights = rng.uniform(6.0, 8.5, 6)
    return tuple(objects.tree(rng, height_m=float(h), levels=levels) for h in heights)
