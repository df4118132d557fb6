"""What stands along a street, piece by piece: houses, trees, hedges, lamps, wires, parked cars."""

from __future__ import annotations

import functools
from typing import Protocol

import numpy as np

from pseudolidar.sources.worlds import objects
from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import Mesh, above, frustum, join, turn_z
from pseudolidar.sources.worlds.road import RoadLine
from pseudolidar.sources.worlds.street_ground import PIECE_M, WALK_EDGE_M, in_side_street
from pseudolidar.sources.worlds.traffic import car_thing
from pseudolidar.sources.worlds.world import Thing

# Left of the middle, or on either side of it, metres: parked cars, lamps, signs and poles at the
# kerb, trees, fronts of the houses, a second row of them.
PARKED_M, POST_M, TREE_M = 5.25, 6.65, 7.1
HOUSE_LINE_M, SECOND_ROW_M = 12.0, 34.5
# Utility poles stand here, metres left of the middle.
POLES_M = -9.6


class Lined(Protocol):
    """A street that things stand along."""

    @property
    def seed(self) -> int:
        """Which street."""

    @property
    def road(self) -> RoadLine:
        """Its centre line."""


def houses(street: Lined, k: int, side: int, rng: np.random.Generator) -> Mesh:
    """A closed or loose row of fronts."""
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
    return join(parts)


def second_row(street: Lined, k: int, side: int, rng: np.random.Generator) -> Mesh:
    """A house behind the others."""
    seed = int(rng.integers(1, 1 << 20))
    mesh = objects.house(rng, front_m=16.0, depth_m=10.0, storeys=3, seed=seed)
    s = k * PIECE_M + rng.uniform(0, 12)
    if in_side_street(k, s, s + 16.0):
        return join([])
    return _beside(street.road, mesh, s, 16.0, side, SECOND_ROW_M)


def _beside(road: RoadLine, mesh: Mesh, s_m: float, front_m: float, side: int, n_m: float) -> Mesh:
    """Put a front that runs from x = 0 to `front_m` along the street, facing it."""
    middle, heading = road.place(s_m + 0.5 * front_m, side * n_m)
    # On the right the front's x axis points back along the street, or it would face away.
    yaw = heading if side > 0 else heading + np.pi
    start = middle - 0.5 * front_m * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return mesh.placed(above(start, 0.1), yaw_rad=yaw)


def green(street: Lined, k: int, side: int, rng: np.random.Generator) -> Mesh:
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


def _hedges(street: Lined, k: int, side: int, rng: np.random.Generator) -> Mesh:
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


def furniture(street: Lined, k: int, side: int, rng: np.random.Generator) -> Mesh:
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


def wires(street: Lined, k: int) -> Mesh:
    """From the pole of this piece to the next."""
    ends = [street.road.place(s, POLES_M) for s in ((k + 0.5) * PIECE_M, (k + 1.5) * PIECE_M)]
    return objects.wires(ends)


def parked(street: Lined, k: int, side: int, rng: np.random.Generator) -> list[tuple[Mesh, Thing]]:
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
