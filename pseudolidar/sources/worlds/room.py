"""A hall: furniture, shelves, pictures, plain walls, people; an AGV that drives round and round."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds import objects
from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import Mesh, frustum, join, tube, turn_z
from pseudolidar.sources.worlds.world import Actor, Light, RigDesign, Surroundings, Thing
from pseudolidar.structures.arrays import Float64

# Half length (x), half width (y) and height of the hall, metres.
HALF_X_M, HALF_Y_M, HEIGHT_M = 8.0, 5.0, 3.2
# The way of the AGV: straights of a rectangle with rounded corners, metres.
STRAIGHT_X_M, STRAIGHT_Y_M, TURN_M = 7.4, 2.2, 1.3
# Height of the Velodyne, metres.
SENSOR_HEIGHT_M = 1.05
WALKING_M_S, STRIDE_M = 1.0, 1.3

WOOD = (0.30, 0.19, 0.11)
WHITE = (0.62, 0.61, 0.57)


@dataclass(frozen=True)
class Room:
    """Drive round a furnished hall with a small stereo camera.

    Args:
        seed: which furniture.
        speed_m_s: speed of the AGV.
    """

    seed: int = 0
    speed_m_s: float = 0.5

    @property
    def design(self) -> RigDesign:
        """Two webcams 7 cm apart, wide angle: 23 px of disparity at 1 m."""
        return RigDesign(
            width_px=640,
            height_px=480,
            focal_px=332.0,
            centre=(0.5, 0.5),
            baseline_m=0.07,
            left_in_base_m=(0.10, 0.035, -0.12),
            pitch_deg=2.0,
        )

    @property
    def light(self) -> Light:
        """One large lamp under the ceiling, and light from everywhere."""
        return Light((0.5, 0.3, 2.75), (1.25, 1.17, 1.0), (0.55, 0.56, 0.58), lamp=True)

    def T_world_base(self, t_s: float) -> Float64:
        """The Velodyne on the AGV."""
        x, y, heading = _loop(self.speed_m_s * t_s)
        return turn_z(heading, (x, y, SENSOR_HEIGHT_M))

    def region(self, t_s: float) -> int:  # noqa: ARG002 - the hall is all there is
        """The hall."""
        return 0

    def surroundings(self, region: int) -> Surroundings:  # noqa: ARG002 - the hall is all there is
        """The hall."""
        return Surroundings((_hall(self.seed),), join([]), (), np.zeros(3))

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """Two people who walk to and fro."""
        return (
            _walker(self.seed, 1, t_s, (-5.5, 3.6), (5.5, 3.6)),
            _walker(self.seed, 2, t_s + 7.0, (6.9, -3.6), (6.9, 3.2)),
        )


def _loop(s_m: float) -> tuple[float, float, float]:
    """Position and heading after `s_m` metres of the way, anticlockwise."""
    arc = 0.5 * np.pi * TURN_M
    x, y, heading = -0.5 * STRAIGHT_X_M, -0.5 * STRAIGHT_Y_M - TURN_M, 0.0
    lap = 2 * (STRAIGHT_X_M + STRAIGHT_Y_M) + 4 * arc
    left = s_m % lap
    for leg in range(8):
        straight = (STRAIGHT_X_M, STRAIGHT_Y_M)[leg // 2 % 2]
        length = min(left, straight if leg % 2 == 0 else arc)
        if leg % 2 == 0:
            x, y = x + length * np.cos(heading), y + length * np.sin(heading)
        else:
            turned = heading + length / TURN_M
            x += TURN_M * (np.sin(turned) - np.sin(heading))
            y += TURN_M * (np.cos(heading) - np.cos(turned))
            heading = turned
        left -= length
    return float(x), float(y), float(heading)


def _walker(
    seed: int, number: int, t_s: float, start: tuple[float, float], end: tuple[float, float]
) -> Actor:
    from_to = np.array(end) - np.array(start)
    length = float(np.linalg.norm(from_to))
    phase = (WALKING_M_S * t_s) % (2 * length)
    there = phase < length
    share = (phase if there else 2 * length - phase) / length
    yaw = float(np.arctan2(from_to[1], from_to[0])) + (0.0 if there else np.pi)
    T = turn_z(yaw, (*(np.array(start) + share * from_to), 0.0))
    rng = np.random.default_rng([seed, 31, number])
    shirt, trousers = (objects.CLOTHES[int(i)] for i in rng.integers(len(objects.CLOTHES), size=2))
    mesh = objects.person(2 * np.pi * WALKING_M_S * t_s / STRIDE_M, shirt, trousers)
    box = T.copy()
    box[2, 3] += 0.5 * objects.PERSON_SIZE_M[2]
    return Actor(Thing(number, "Pedestrian", box, objects.PERSON_SIZE_M), mesh.moved(T))


@functools.lru_cache(maxsize=2)
def _hall(seed: int) -> Mesh:
    rng = np.random.default_rng([seed, 30])
    parts = [_shell(), *_pictures(rng), *_shelves(rng), *_tables(rng), *_boxes(rng), *_plants(rng)]
    for x in (-3.7, 3.7):
        parts.append(
            tube(
                np.array([[x, 0, 0], [x, 0, HEIGHT_M]], float),
                (0.16, 0.16),
                Material.PLASTER,
                WHITE,
                sides=16,
            )
        )
    return join(parts)


def _shell() -> Mesh:
    """Floor, ceiling and plain walls, as thin slabs around the hall."""
    x, y, z, d = HALF_X_M, HALF_Y_M, HEIGHT_M, 0.2
    walls = [
        ((-x - d, -y, 0), (-x, y, z)),
        ((x, -y, 0), (x + d, y, z)),
        ((-x, -y - d, 0), (x, -y, z)),
        ((-x, y, 0), (x, y + d, z)),
    ]
    parts = [
        frustum(low, high, Material.PLASTER, WHITE, seed=40 + k)
        for k, (low, high) in enumerate(walls)
    ]
    parts.append(frustum((-x, -y, -d), (x, y, 0), Material.PLANKS, (0.34, 0.23, 0.14), seed=7))
    parts.append(frustum((-x, -y, z), (x, y, z + d), Material.PAVEMENT, (0.72, 0.72, 0.7), seed=8))
    d = 0.02
    skirtings = [
        ((-x, -y, 0), (-x + d, y, 0.1)),
        ((x - d, -y, 0), (x, y, 0.1)),
        ((-x, -y, 0), (x, -y + d, 0.1)),
        ((-x, y - d, 0), (x, y, 0.1)),
    ]
    parts += [frustum(low, high, Material.PLAIN, (0.25, 0.2, 0.15)) for low, high in skirtings]
    return join(parts)


def _on_wall(mesh: Mesh, wall: int, along_m: float, height_m: float) -> Mesh:
    """Put a thing whose back is at y = 0 on wall 0-3, `along_m` from its middle."""
    yaw = wall * np.pi / 2
    out = HALF_Y_M if wall % 2 == 0 else HALF_X_M
    place = np.array(
        [
            along_m * np.cos(yaw) - out * np.sin(yaw),
            along_m * np.sin(yaw) + out * np.cos(yaw),
            height_m,
        ]
    )
    return mesh.placed(place, yaw_rad=yaw)


def _pictures(rng: np.random.Generator) -> list[Mesh]:
    parts = []
    for wall in range(4):
        reach = (HALF_X_M if wall % 2 == 0 else HALF_Y_M) - 1.0
        for along in np.arange(-reach, reach, 2.1):
            if rng.random() < 0.35:
                continue
            wide, high = rng.uniform(0.5, 1.2), rng.uniform(0.5, 0.9)
            picture = frustum(
                (0, -0.03, 0),
                (wide, 0, high),
                Material.POSTER,
                WHITE,
                seed=int(rng.integers(1 << 20)),
            )
            frame = frustum(
                (-0.05, -0.02, -0.05),
                (wide + 0.05, 0, high + 0.05),
                Material.PLAIN,
                (0.05, 0.04, 0.03),
            )
            parts.append(_on_wall(join([frame, picture]), wall, along + rng.uniform(0, 0.6), 1.45))
    return parts


def _shelves(rng: np.random.Generator) -> list[Mesh]:
    parts = []
    for wall, along in ((0, -6.0), (0, 2.8), (2, -2.0), (2, 4.6), (1, 1.0), (3, -2.2), (3, 2.0)):
        wide, high = rng.uniform(1.4, 2.2), (1.08, 1.44, 1.8)[int(rng.integers(3))]
        shelf = frustum(
            (0, -0.34, 0), (wide, 0, high), Material.SHELF, WOOD, seed=int(rng.integers(1 << 20))
        )
        top = frustum((-0.02, -0.36, high), (wide + 0.02, 0, high + 0.03), Material.PLANKS, WOOD)
        parts.append(_on_wall(join([shelf, top]), wall, along, 0.0))
    return parts


def _tables(rng: np.random.Generator) -> list[Mesh]:
    parts = []
    for x in (-2.2, 0.0, 2.2):
        seed = int(rng.integers(1 << 20))
        top = frustum((-0.8, -0.4, 0.71), (0.8, 0.4, 0.75), Material.PLANKS, WOOD, seed=seed)
        legs = [
            tube(
                np.array([[a, b, 0], [a, b, 0.71]]),
                (0.025, 0.025),
                Material.METAL,
                (0.2, 0.2, 0.2),
                sides=8,
            )
            for a in (-0.74, 0.74)
            for b in (-0.34, 0.34)
        ]
        things = [
            frustum(
                (u, v, 0.75),
                (u + 0.28, v + 0.2, 0.75 + rng.uniform(0.02, 0.28)),
                Material.POSTER,
                WHITE,
                seed=int(rng.integers(1 << 20)),
            )
            for u, v in ((-0.6, -0.25), (0.1, 0.0), (0.4, -0.3))
        ]
        table = join([top, *legs, *things])
        parts.append(table.placed((x, rng.uniform(-0.1, 0.1), 0), yaw_rad=rng.uniform(-0.1, 0.1)))
        for side in (-1.0, 1.0):
            chair = _chair(int(rng.integers(1 << 20)))
            parts.append(
                chair.placed(
                    (x + rng.uniform(-0.3, 0.3), 0.62 * side, 0),
                    yaw_rad=np.pi / 2 * (1 - side) + rng.uniform(-0.4, 0.4),
                )
            )
    return parts


def _chair(seed: int) -> Mesh:
    """A chair whose back is towards +y."""
    colour = objects.CLOTHES[seed % len(objects.CLOTHES)]
    seat = frustum((-0.21, -0.21, 0.43), (0.21, 0.21, 0.47), Material.CLOTH, colour, seed=seed)
    back = frustum((-0.21, 0.18, 0.55), (0.21, 0.21, 0.9), Material.CLOTH, colour, seed=seed)
    legs = [
        tube(
            np.array([[a, b, 0], [a, b, 0.43 if b < 0 else 0.9]]),
            (0.015, 0.015),
            Material.METAL,
            (0.35, 0.35, 0.35),
            sides=6,
        )
        for a in (-0.19, 0.19)
        for b in (-0.19, 0.19)
    ]
    return join([seat, back, *legs])


def _boxes(rng: np.random.Generator) -> list[Mesh]:
    """Cartons, some on top of others."""
    parts = []
    for x, y in ((-6.8, -3.9), (-6.3, 3.4), (6.4, -4.2), (1.2, -4.4), (-2.9, 4.3), (6.9, 4.2)):
        base = 0.0
        for _ in range(int(rng.integers(1, 4))):
            a, b, h = rng.uniform(0.35, 0.7), rng.uniform(0.3, 0.5), rng.uniform(0.25, 0.5)
            carton = frustum(
                (-a / 2, -b / 2, base),
                (a / 2, b / 2, base + h),
                Material.CLOTH,
                (0.36, 0.24, 0.14),
                seed=int(rng.integers(1 << 20)),
            )
            parts.append(carton.placed((x, y, 0), yaw_rad=rng.uniform(-0.5, 0.5)))
            base += h
    return parts


def _plants(rng: np.random.Generator) -> list[Mesh]:
    parts = []
    for x, y in ((-7.3, 0.0), (7.3, -2.6), (-0.6, 4.4), (3.6, 0.7), (-4.0, -4.4)):
        pot = tube(
            np.array([[0, 0, 0], [0, 0, 0.4]], float),
            (0.16, 0.21),
            Material.BRICK,
            (0.3, 0.12, 0.07),
            sides=14,
        )
        leaves = objects.bush(rng, radius_m=rng.uniform(0.3, 0.45)).placed((0, 0, 0.45))
        parts.append(join([pot, leaves]).placed((x, y, 0)))
    return parts
