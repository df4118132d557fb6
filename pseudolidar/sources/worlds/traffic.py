"""Cars and persons that move along a road: pure functions of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.sources.worlds import objects
from pseudolidar.sources.worlds.meshes import above, turn_z
from pseudolidar.sources.worlds.road import Road
from pseudolidar.sources.worlds.world import Actor, Thing
from pseudolidar.structures.arrays import Float64

# How far things are made: behind and ahead of the camera, metres.
BEHIND_M, AHEAD_M = 60.0, 200.0
# Mean spacing of oncoming cars, and of persons on one pavement, metres.
ONCOMING_M, WALKERS_M = 55.0, 23.0
ONCOMING_SPEED_M_S, WALKING_M_S = 9.0, 1.3
# The car ahead keeps this distance, and breathes around it, metres.
LEADER_M, LEADER_SWING_M = 24.0, 5.0
# A stride of both legs, metres.
STRIDE_M = 1.5
# First numbers of each kind of moving thing.
LEADER, ONCOMING, WALKER, CROSSING = 1, 10_000, 100_000, 500_000
# The car from a side street passes when the camera is this far from it, metres.
CROSSING_GAP_M, CROSSING_SPEED_M_S, CROSSING_HALF_M = 34.0, 7.0, 70.0


@dataclass(frozen=True)
class Traffic:
    """Everyone on the road.

    Args:
        seed: whose cars.
        road: where they move.
        speed_m_s: mean speed of the camera's car and of the one ahead.
        side_streets_m: arc length of the first side street, and from each to the next; cars come
            out of them. None where there are none.
        lane_m: middle of a lane from the middle of the road; pavement_m: where people walk.
        pavement_height_m: over the road.
    """

    seed: int
    road: Road
    speed_m_s: float
    side_streets_m: tuple[float, float] | None = None
    lane_m: float = 1.75
    pavement_m: float = 7.7
    pavement_height_m: float = 0.14

    def own_s(self, t_s: float) -> float:
        """Arc length of the camera's car: a steady pace that swells and ebbs."""
        return self.speed_m_s * t_s + 1.5 * (1.0 - float(np.cos(0.35 * t_s)))

    def actors(self, t_s: float) -> tuple[Actor, ...]:
        """Who is within sight."""
        own = self.own_s(t_s)
        leader = own + LEADER_M + LEADER_SWING_M * float(np.sin(0.3 * t_s + self.seed))
        cars = [self._car(LEADER, leader, -self.lane_m, ahead=True)]
        cars += self._oncoming(t_s, own)
        cars += self._crossing(own, *self.side_streets_m) if self.side_streets_m else []
        return tuple(cars + self._walkers(t_s, own))

    def _car(self, number: int, s_m: float, n_m: float, *, ahead: bool) -> Actor:
        place, heading = self.road.place(s_m, n_m)
        return car_actor(self.seed, number, place, heading + (0.0 if ahead else np.pi))

    def _oncoming(self, t_s: float, own_m: float) -> list[Actor]:
        moved = -ONCOMING_SPEED_M_S * t_s
        first = int(np.ceil((own_m - BEHIND_M - moved) / ONCOMING_M))
        last = int(np.floor((own_m + AHEAD_M - moved) / ONCOMING_M))
        found = []
        for k in range(first, last + 1):
            jitter = np.random.default_rng([self.seed, 21, k + 1_000_000]).uniform(-18.0, 18.0)
            place = k * ONCOMING_M + jitter + moved
            found.append(self._car(ONCOMING + k % 50_000, place, self.lane_m, ahead=False))
        return found

    def _crossing(self, own_m: float, first_m: float, every_m: float) -> list[Actor]:
        k = round((own_m - first_m) / every_m)
        found = []
        for number in (k, k + 1):
            where = first_m + number * every_m
            side = 1.0 if number % 2 == 0 else -1.0
            # The camera reaches the gap before the crossing about when the car is in its middle.
            across = (where - CROSSING_GAP_M - own_m) / self.speed_m_s * CROSSING_SPEED_M_S
            if abs(across) > CROSSING_HALF_M:
                continue
            place, heading = self.road.place(where + side * self.lane_m, side * across)
            yaw = heading - side * np.pi / 2
            found.append(car_actor(self.seed, CROSSING + number % 50_000, place, yaw))
        return found

    def _walkers(self, t_s: float, own_m: float) -> list[Actor]:
        found = []
        for side in (1, -1):
            for way in (1, -1):
                moved = way * WALKING_M_S * t_s
                first = int(np.ceil((own_m - 10.0 - moved) / WALKERS_M))
                last = int(np.floor((own_m + 90.0 - moved) / WALKERS_M))
                for k in range(first, last + 1):
                    found.append(self._walker(k, side, way, moved))
        return found

    def _walker(self, k: int, side: int, way: int, moved_m: float) -> Actor:
        rng = np.random.default_rng([self.seed, 22, side + 1, way + 1, k + 1_000_000])
        s = k * WALKERS_M + rng.uniform(-8.0, 8.0) + moved_m
        n = side * (self.pavement_m + 0.55 * way + rng.uniform(-0.2, 0.2))
        place, heading = self.road.place(s, n)
        shirt, trousers = (
            objects.CLOTHES[int(i)] for i in rng.integers(len(objects.CLOTHES), size=2)
        )
        T = turn_z(heading + (0.0 if way > 0 else np.pi), above(place, self.pavement_height_m))
        mesh = objects.person(2 * np.pi * s * way / STRIDE_M, shirt, trousers)
        number = WALKER + 4 * (k % 50_000) + (side + 1) + (way + 1) // 2
        box = T.copy()
        box[2, 3] += 0.5 * objects.PERSON_SIZE_M[2]
        return Actor(Thing(number, "Pedestrian", box, objects.PERSON_SIZE_M), mesh.moved(T))


def car_actor(seed: int, number: int, place_m: Float64, yaw_rad: float) -> Actor:
    """A moving car on the ground at a place."""
    T = turn_z(yaw_rad, place_m)
    colour = objects.CAR_COLOURS[(number * 7 + seed) % len(objects.CAR_COLOURS)]
    return Actor(car_thing(number, T), objects.car(colour).moved(T))


def car_thing(number: int, T_world_ground: Float64) -> Thing:
    """Label of a car that stands at a pose."""
    T = T_world_ground.copy()
    T[:3, 3] += T[:3, 2] * 0.5 * objects.CAR_SIZE_M[2]
    return Thing(number, "Car", T, objects.CAR_SIZE_M)
