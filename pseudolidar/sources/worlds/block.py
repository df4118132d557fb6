"""A block of houses in the middle of four streets: whoever drives on comes back."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import Mesh, above, body_pose, join, sheet
from pseudolidar.sources.worlds.street import LANE_M, SENSOR_HEIGHT_M, Street
from pseudolidar.sources.worlds.street_ground import (
    GREEN,
    PIECE_M,
    carriageway,
    is_crossing,
    verge,
)
from pseudolidar.sources.worlds.street_sides import (
    furniture,
    green,
    houses,
    parked,
    second_row,
    wires,
)
from pseudolidar.sources.worlds.world import Actor, Light, RigDesign, Surroundings, Thing
from pseudolidar.structures.arrays import Float64

# Straight pieces and corners in turns, each as long as a piece of the street.
PIECES = 8
ROUND_M = PIECES * PIECE_M
CORNER_RADIUS_M = PIECE_M / (np.pi / 2)
# Land inside reaches to just before the middle of a corner, metres from the road's middle.
INSIDE_M = 20.0
# Half the side of the square that is left in the middle of the block.
HALF_MIDDLE_M = PIECE_M / 2 + CORNER_RADIUS_M - INSIDE_M + 0.1
# The second time round the car is up to so far beside its first path, metres.
SWAY_M, SWAY_EVERY_M = 0.35, 173.0


@dataclass(frozen=True)
class BlockRoad:
    """A closed centre line: a square with round corners, driven with the block on the left."""

    def at(self, s_m: Float64, n_m: Float64) -> Float64:
        """(N, 3) world position `s_m` along, `n_m` to the left; the land is flat."""
        s = np.mod(s_m, ROUND_M)
        side, along = np.divmod(s, 2 * PIECE_M)
        bent_m = np.maximum(along - PIECE_M, 0.0)
        turned = bent_m / CORNER_RADIUS_M
        radius = CORNER_RADIUS_M - n_m
        x = np.minimum(along, PIECE_M) - PIECE_M / 2 + radius * np.sin(turned)
        y = -PIECE_M / 2 - radius * np.cos(turned)
        cos, sin = np.cos(side * np.pi / 2), np.sin(side * np.pi / 2)
        return np.column_stack([cos * x - sin * y, sin * x + cos * y, np.zeros_like(x)])

    def place(self, s_m: float, n_m: float) -> tuple[Float64, float]:
        """(3,) world position and heading (rad) of one spot."""
        side, along = np.divmod(s_m % ROUND_M, 2 * PIECE_M)
        turned = max(along - PIECE_M, 0.0) / CORNER_RADIUS_M
        spot = self.at(np.array([s_m]), np.array([n_m]))[0]
        return spot, float(side * np.pi / 2 + turned)


@dataclass(frozen=True)
class Block:
    """Drive round a block: 256 m of four streets, left turns only, nobody else on the road.

    Args:
        seed: which block.
        speed_m_s: speed of the car with the cameras.
    """

    seed: int = 0
    speed_m_s: float = 8.0

    @property
    def design(self) -> RigDesign:
        """The street's."""
        return Street().design

    @property
    def light(self) -> Light:
        """The street's."""
        return Street(self.seed).light

    @property
    def road(self) -> BlockRoad:
        """Its centre line."""
        return BlockRoad()

    def T_world_base(self, t_s: float) -> Float64:
        """The Velodyne on a car in the right lane, with a little pitch, roll, bounce and sway."""
        s = self.speed_m_s * t_s + PIECE_M / 4
        sway = SWAY_M * float(np.sin(2 * np.pi * s / SWAY_EVERY_M))
        spot, heading = self.road.place(s, sway - LANE_M)
        pitch = 0.003 * float(np.sin(5.1 * t_s))
        roll = 0.004 * float(np.sin(3.3 * t_s + 1.0))
        lift = SENSOR_HEIGHT_M + 0.012 * float(np.sin(6.7 * t_s))
        return body_pose(above(spot, lift), yaw_rad=heading, pitch_rad=pitch, roll_rad=roll)

    def region(self, t_s: float) -> int:
        """All of it is made at once."""
        del t_s
        return 0

    def surroundings(self, region: int) -> Surroundings:
        """All pieces."""
        del region
        numbers = [_number(place) for place in range(PIECES)]
        pieces = [_piece(self, k) for k in numbers]
        return Surroundings(
            meshes=(_middle(), *(mesh for mesh, _ in pieces)),
            thin=join([wires(self, k) for k in numbers]),
            things=tuple(thing for _, things in pieces for thing in things),
            origin_m=np.zeros(3),
        )

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """Nobody."""
        del t_s
        return ()


def _number(place: int) -> int:
    """Number of the street's piece that stands at a place of the round: one without crossing."""
    return place if not is_crossing(place) else place + PIECES


def _middle() -> Mesh:
    """Grass in the middle of the block."""
    edge = np.array([-HALF_MIDDLE_M, HALF_MIDDLE_M])
    x, y = np.meshgrid(edge, edge, indexing="ij")
    points = np.stack([x, y, np.full_like(x, 0.3)], axis=-1)
    return sheet(points, Material.GRASS, GREEN, texture=points, seed=1)


@functools.lru_cache(maxsize=PIECES)
def _piece(block: Block, k: int) -> tuple[Mesh, tuple[Thing, ...]]:
    rng = np.random.default_rng([block.seed, 2000, k])
    span = (k * PIECE_M, (k + 1) * PIECE_M)
    parts = [carriageway(block.road, span)]
    parts += verge(block.road, span, 1.0, land_to_m=INSIDE_M)
    parts += verge(block.road, span, -1.0)
    things: list[Thing] = []
    for side in (1, -1):
        if side < 0 or k % 2 == 0:  # inside a corner there is no room
            parts.append(houses(block, k, side, rng))
        if side < 0:
            parts.append(second_row(block, k, side, rng))
        parts.append(green(block, k, side, rng))
        parts.append(furniture(block, k, side, rng))
        cars = parked(block, k, side, rng)
        parts += [mesh for mesh, _ in cars]
        things += [thing for _, thing in cars]
    return join(parts), tuple(things)
