"""A drone over the countryside: fields, trees, farms, a road; it climbs, yaws and looks down."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds import objects
from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import Colour, Mesh, above, body_pose, join, sheet
from pseudolidar.sources.worlds.road import Road, texture_start
from pseudolidar.sources.worlds.traffic import Traffic
from pseudolidar.sources.worlds.world import Actor, Light, RigDesign, Surroundings
from pseudolidar.structures.arrays import Float64

PIECE_M = 40.0
PIECES_BEHIND, PIECES_AHEAD = 2, 9
# The land is flat within this distance of the road and rolls beyond, metres.
FLAT_M, ROLLING_M, HILL_M = 9.0, 60.0, 7.0
# Limits of fields on either side of the road, metres.
FIELDS_M = (4.5, 9.0, 38.0, 75.0, 130.0, 260.0)
FIELD_STEP_M = 4.0
# Utility poles stand here, metres left of the middle of the road.
POLES_M = 5.6
# How finely trees are made near the road and farther from it, metres.
TREE_LEVELS, TREE_RANGES_M = (3, 2, 1), (15.0, 50.0)
# Height of the flight: mean and swing, metres; lengths of its waves, seconds.
HEIGHT_M, CLIMB_M, CLIMB_S, YAW_S = 15.0, 4.0, 31.0, 17.0
FIELD_COLOURS: tuple[tuple[Material, Colour], ...] = (
    (Material.GRASS, (0.10, 0.15, 0.05)),
    (Material.FIELD, (0.30, 0.25, 0.11)),
    (Material.FIELD, (0.17, 0.11, 0.07)),
    (Material.GRASS, (0.07, 0.12, 0.04)),
    (Material.FIELD, (0.13, 0.20, 0.06)),
    (Material.GRAVEL, (0.22, 0.18, 0.13)),
)


@dataclass(frozen=True)
class Flight:
    """Fly along a country road.

    Args:
        seed: which country.
        speed_m_s: ground speed.
    """

    seed: int = 0
    speed_m_s: float = 6.0

    @property
    def design(self) -> RigDesign:
        """Two cameras 0.3 m apart that look 16 degrees down."""
        return RigDesign(
            width_px=848,
            height_px=480,
            focal_px=560.0,
            centre=(0.5, 0.5),
            baseline_m=0.3,
            left_in_base_m=(0.12, 0.15, -0.05),
            pitch_deg=16.0,
        )

    @property
    def light(self) -> Light:
        """Morning sun from the right."""
        return Light(
            (-0.35, -0.6, 0.7),
            (1.6, 1.45, 1.2),
            (0.40, 0.46, 0.55),
            haze_m=1000.0,
            sky_seed=self.seed + 50,
        )

    @property
    def road(self) -> Road:
        """The road below."""
        return Road(self.seed + 100, bend_rad=0.5, hill_m=3.0)

    @property
    def traffic(self) -> Traffic:
        """Cars and walkers on the road."""
        return Traffic(
            self.seed,
            self.road,
            self.speed_m_s,
            lane_m=1.5,
            pavement_m=4.2,
            pavement_height_m=0.0,
        )

    def T_world_base(self, t_s: float) -> Float64:
        """The Velodyne on the drone: it rises and sinks beside the road and swings its nose."""
        s = np.array([self.speed_m_s * t_s])
        across = 3.0 * np.sin(2 * np.pi * t_s / 23.0)
        place, heading = self.road.place(float(s[0]), across)
        height = HEIGHT_M - CLIMB_M * np.cos(2 * np.pi * t_s / CLIMB_S)
        yaw = heading + 0.35 * np.sin(2 * np.pi * t_s / YAW_S)
        pitch, roll = 0.03 * np.sin(0.9 * t_s), 0.06 * np.sin(2 * np.pi * t_s / YAW_S + 0.6)
        place = above(place, float(height))
        return body_pose(place, yaw_rad=float(yaw), pitch_rad=float(pitch), roll_rad=float(roll))

    def region(self, t_s: float) -> int:
        """Piece of the road that the drone is over."""
        return int(self.speed_m_s * t_s // PIECE_M)

    def surroundings(self, region: int) -> Surroundings:
        """Pieces behind and ahead."""
        numbers = range(region - PIECES_BEHIND, region + PIECES_AHEAD + 1)
        origin, _ = self.road.place(region * PIECE_M, 0.0)
        return Surroundings(
            meshes=tuple(_piece(self, k) for k in numbers),
            thin=join([_wires(self, k) for k in numbers]),
            things=(),
            origin_m=np.round(origin),
        )

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """Who is on the road."""
        return self.traffic.actors(t_s)

    def land(self, s_m: Float64, n_m: Float64) -> Float64:
        """(N, 3) the ground at places along and beside the road."""
        points = self.road.at(s_m, n_m)
        phases = np.random.default_rng([self.seed, 61]).uniform(0, 6.28, 4)
        rolling = np.clip((np.abs(n_m) - FLAT_M) / ROLLING_M, 0.0, 1.5) ** 1.5
        wave = np.sin(s_m / 33.0 + phases[0]) + 0.6 * np.sin(s_m / 15.0 - n_m / 27.0 + phases[1])
        wave = (
            wave + np.sin(n_m / 41.0 + phases[2]) + 0.3 * np.sin(n_m / 11.0 + s_m / 9.0 + phases[3])
        )
        points[:, 2] += HILL_M * rolling * (0.35 + 0.4 * wave)
        return points


@functools.lru_cache(maxsize=PIECES_BEHIND + PIECES_AHEAD + 2)
def _piece(flight: Flight, k: int) -> Mesh:
    rng = np.random.default_rng([flight.seed, 60, k + 1_000_000])
    return join(
        [_ground(flight, k, rng), _trees(flight, k, rng), _farm(flight, k, rng), _pole(flight, k)]
    )


def _ground(flight: Flight, k: int, rng: np.random.Generator) -> Mesh:
    start, end = k * PIECE_M, (k + 1) * PIECE_M
    parts = [_field(flight, start, end, -3.0, 3.0, Material.ASPHALT, (0.13, 0.13, 0.13), 1)]
    for side in (1.0, -1.0):
        parts.append(
            _field(
                flight,
                start,
                end,
                side * 3.0,
                side * FIELDS_M[0],
                Material.GRAVEL,
                (0.24, 0.21, 0.16),
                2,
            )
        )
        for j in range(len(FIELDS_M) - 1):
            material, colour = FIELD_COLOURS[int(rng.integers(len(FIELD_COLOURS)))]
            if j == 0:
                material, colour = FIELD_COLOURS[0]
            parts.append(
                _field(
                    flight,
                    start,
                    end,
                    side * FIELDS_M[j],
                    side * FIELDS_M[j + 1],
                    material,
                    colour,
                    int(rng.integers(1, 9)),
                )
            )
    return join(parts)


def _field(
    flight: Flight,
    start: float,
    end: float,
    near: float,
    far: float,
    material: Material,
    colour: Colour,
    seed: int,
) -> Mesh:
    s = np.linspace(start, end, int((end - start) / FIELD_STEP_M) + 1)
    n = np.linspace(near, far, max(2, int(abs(far - near) / FIELD_STEP_M) + 1))
    S, N = np.meshgrid(s, n, indexing="ij")
    points = flight.land(S.ravel(), N.ravel()).reshape(*S.shape, 3)
    period, origin = texture_start(start)
    texture = np.stack([S - origin, N, np.zeros_like(S)], axis=-1)
    return sheet(points, material, colour, texture=texture, seed=seed + period)


def _trees(flight: Flight, k: int, rng: np.random.Generator) -> Mesh:
    """Trees along the road, hedgerows between fields, and copses."""
    parts = []
    models = [_models(flight.seed, levels) for levels in TREE_LEVELS]
    spots = [
        (s, side * rng.uniform(6.5, 8.0))
        for s in np.arange(4.0, PIECE_M, 13.0)
        for side in (1, -1)
        if rng.random() < 0.5
    ]
    spots += [
        (rng.uniform(0, PIECE_M), side * (limit + rng.uniform(-2, 2)))
        for side in (1, -1)
        for limit in FIELDS_M[2:4]
        for _ in range(4)
    ]
    copse, side = rng.uniform(0, PIECE_M), float(rng.choice([-1.0, 1.0]))
    spots += [(copse + rng.normal(0, 7.0), side * (26.0 + rng.normal(0, 5.0))) for _ in range(6)]
    for along, n in spots:
        detail = int(np.searchsorted(TREE_RANGES_M, abs(n)))
        model = models[detail][int(rng.integers(6))]
        place = flight.land(np.array([k * PIECE_M + along]), np.array([n]))[0]
        parts.append(
            model.placed(place, yaw_rad=rng.uniform(0, 6.28), scale=rng.uniform(0.7, 1.05))
        )
    return join(parts)


def _farm(flight: Flight, k: int, rng: np.random.Generator) -> Mesh:
    """Two or three houses beside the road, here and there."""
    parts = []
    for _ in range(int(rng.integers(0, 4))):
        front, seed = rng.uniform(8.0, 14.0), int(rng.integers(1, 1 << 20))
        mesh = objects.house(
            rng,
            front_m=front,
            depth_m=rng.uniform(7, 10),
            storeys=int(rng.integers(1, 3)),
            seed=seed,
        )
        s, n = (
            k * PIECE_M + rng.uniform(0, PIECE_M),
            float(rng.choice([-1.0, 1.0])) * rng.uniform(13, 34),
        )
        place = flight.land(np.array([s]), np.array([n]))[0]
        parts.append(mesh.placed(place, yaw_rad=rng.uniform(0, 6.28)))
    return join(parts)


def _pole(flight: Flight, k: int) -> Mesh:
    place, heading = flight.road.place(k * PIECE_M, POLES_M)
    return objects.utility_pole().placed(place, yaw_rad=heading)


def _wires(flight: Flight, k: int) -> Mesh:
    """From the pole of this piece to the next."""
    ends = [flight.road.place(s, POLES_M) for s in (k * PIECE_M, (k + 1) * PIECE_M)]
    return objects.wires(ends, radius_m=0.022)


@functools.lru_cache(maxsize=4)
def _models(seed: int, levels: int) -> tuple[Mesh, ...]:
    rng = np.random.default_rng([seed, 62])
    heights = rng.uniform(5.0, 9.0, 6)
    return tuple(objects.tree(rng, height_m=float(h), levels=levels) for h in heights)
