"""A street with crossing and turning cars, as boxes: exact truth, and what a stereo rig sees of it.

No pictures are made: what hides what is decided by the outlines of the boxes, and each thing that
is seen gets a place disturbed as stereo does: far along the ray, little across it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.tracks import TrueObject
from pseudolidar.geometry.box_in_view import outline_px
from pseudolidar.geometry.frames import R_BODY_OPTICAL
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, Detection
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

WIDTH, HEIGHT, FOCAL_PX, BASELINE_M = 1242, 375, 721.5, 0.54
CAMERA = Camera(np.array([[FOCAL_PX, 0, 620.5], [0, FOCAL_PX, 173.0], [0, 0, 1.0]]), WIDTH, HEIGHT)
CAR, PERSON = ("Car", (4.0, 1.7, 1.5)), ("Pedestrian", (0.8, 0.65, 1.74))
OWN_SPEED_M_S, EYE_HEIGHT_M, RATE_HZ = 8.0, 1.65, 10.0
# Of a speed that swells and ebbs: its share of the mean, and how quickly.
SWING_SHARE, SWING_RAD_S = 0.15, 0.8
CORNER_M, CAR_APART_M, PERSON_APART_M = 9.0, 3.6, 2.2
TO_M, LEAST_SEEN, CELL_PX = 70.0, 0.35, 6


@dataclass(frozen=True)
class Errors:
    """What goes wrong between a thing and its obstacle.

    Args:
        disparity_px: one standard deviation, all kinds together.
        rig_px: of that what the rig's calibration leaves, the same for all things of a street.
        persistent: share of the other's variance that stays; for persistent_s.
        missed: share of the detections that fail; hidden_missed of those half hidden.
        false: detections of nothing, in the mean of a frame.
    """

    disparity_px: float = 0.25
    rig_px: float = 0.15
    persistent: float = 0.5
    persistent_s: float = 3.0
    missed: float = 0.05
    hidden_missed: float = 0.3
    false: float = 0.3


@dataclass(frozen=True)
class Driver:
    """Straight on, then perhaps around a corner; its speed swells and ebbs."""

    number: int
    kind: tuple[str, tuple[float, float, float]]
    start: tuple[float, float]
    heading: float
    speed_m_s: float
    straight_m: float = math.inf
    way: float = 0.0  # +1 turns left by 90 degrees, -1 right
    phase: float = 0.0

    def at(self, t_s: float) -> tuple[Float64, float, Float64]:
        """Place of the middle of the box, heading, velocity."""
        swing = SWING_SHARE * self.speed_m_s / SWING_RAD_S
        angle = SWING_RAD_S * t_s + self.phase
        gone = self.speed_m_s * t_s + swing * (math.sin(angle) - math.sin(self.phase))
        speed = self.speed_m_s + swing * SWING_RAD_S * math.cos(angle)
        ahead, heading = min(gone, self.straight_m), self.heading
        place = np.array(self.start) + ahead * _direction(heading)
        if self.way and gone > self.straight_m:
            turned = min((gone - ahead) / CORNER_M, math.pi / 2)
            middle = place + CORNER_M * _direction(heading + self.way * math.pi / 2)
            heading += self.way * turned
            place = middle + CORNER_M * _direction(heading - self.way * math.pi / 2)
            place = place + (gone - ahead - CORNER_M * turned) * _direction(heading)
        return (
            np.array([*place, self.kind[1][2] / 2]),
            heading,
            np.array([*(speed * _direction(heading)), 0.0]),
        )


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame: what is fed to a tracker, and the truth."""

    timestamp_ns: int
    T_map_camera: Pose
    obstacles: tuple[Obstacle, ...]
    truth: tuple[TrueObject, ...]


def moments(
    seed: int, seconds: float = 8.0, errors: Errors | None = None, *, rate_hz: float = RATE_HZ
) -> Iterator[Moment]:
    """Frames of a street."""
    errors = Errors() if errors is None else errors
    rng = np.random.default_rng([seed, 6])
    drivers = _drivers(np.random.default_rng([seed, 5]), seconds)
    lasting: dict[int, float] = {}
    rig = float(np.random.default_rng([seed, 7]).standard_normal())
    keeps = math.exp(-1.0 / rate_hz / errors.persistent_s)
    for index in range(round(seconds * rate_hz)):
        t_s = index / rate_hz
        T = own_pose(t_s)
        truth, seen = _in_view(drivers, t_s, T)
        obstacles = []
        for one in truth:
            fresh = rng.standard_normal()
            old = lasting.get(one.number)
            now = fresh if old is None else keeps * old + math.sqrt(1 - keeps**2) * fresh
            lasting[one.number] = now
            share = seen[one.number]
            lost = rng.random() < errors.missed + (errors.hidden_missed if share < 0.6 else 0.0)
            noise = rng.standard_normal(10)
            if one.seen and not lost:
                name = next(d.kind[0] for d in drivers if d.number == one.number)
                obstacles.append(_measured(name, one.box, errors, (now, rig), noise))
        for _ in range(rng.poisson(errors.false)):
            obstacles.append(_false(rng, errors, rig))
        yield Moment(1_000_000_000 + round(t_s * 1e9), T, tuple(obstacles), tuple(truth))


def own_pose(t_s: float) -> Pose:
    """`T_map_camera_left`: along x, its heading and speed swing a little."""
    yaw, pitch = 0.06 * math.sin(0.5 * t_s), 0.003 * math.sin(5.0 * t_s)
    c, s = math.cos(yaw), math.sin(yaw)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0, 0, 1.0]])
    cp, sp = math.cos(pitch), math.sin(pitch)
    tilted = np.array([[cp, 0.0, sp], [0, 1.0, 0], [-sp, 0.0, cp]])
    place = np.array([OWN_SPEED_M_S * t_s + 1.5 * (1 - math.cos(0.35 * t_s)), -1.75, EYE_HEIGHT_M])
    return Pose.from_rotation("map", "camera_left", turned @ tilted @ R_BODY_OPTICAL, place)


def _drivers(rng: np.random.Generator, seconds: float) -> list[Driver]:
    """Who is there; whoever would drive through another one is not."""
    drivers = [Driver(1, CAR, (22.0 + rng.uniform(-4, 4), -1.75), 0.0, OWN_SPEED_M_S)]
    for k in range(8):
        start = (45.0 * k + rng.uniform(-12, 12), 1.75)
        drivers.append(_swinging(rng, 200 + k, CAR, start, math.pi, rng.uniform(8.0, 9.0)))
    for k, t_s in enumerate(np.arange(1.0, seconds + 2.0, 0.8)):
        side, way = float(rng.choice([1.0, -1.0])), float(rng.choice([0.0, 0.0, 1.0, -1.0]))
        speed = rng.uniform(3.5, 5.5) if way else rng.uniform(4.0, 10.0)
        start = (OWN_SPEED_M_S * t_s + rng.uniform(12.0, 38.0), side * speed * t_s)
        # Out of the corner it is in the middle of the lane that leads its way.
        straight_m = max(abs(start[1]) - CORNER_M + 1.75 * way, 0.0) if way else math.inf
        crossing = _swinging(
            rng, 100 + k, CAR, start, -side * math.pi / 2, speed, straight_m=straight_m, way=way
        )
        drivers += [crossing] if _is_free(crossing, drivers, seconds) else []
    for side in (1, -1):
        for k in range(20):
            place = (6.5 * k + rng.uniform(-0.4, 0.4), side * 5.25)
            parked = Driver(350 + 50 * side + k, CAR, place, 0.0 if side < 0 else 3.1, 0.0)
            if rng.random() < 0.5 and _is_free(parked, drivers, seconds):
                drivers.append(parked)
        for k in range(8):
            start = (14.0 * k + rng.uniform(-5, 5), side * (8.4 + rng.uniform(-0.5, 0.5)))
            heading = 0.0 if rng.random() < 0.5 else math.pi
            walker = Driver(650 + 50 * side + k, PERSON, start, heading, rng.uniform(1.0, 1.6))
            if _is_free(walker, drivers, seconds):
                drivers.append(walker)
    return drivers


def _swinging(
    rng: np.random.Generator,
    number: int,
    kind: tuple[str, tuple[float, float, float]],
    start: tuple[float, float],
    heading: float,
    speed_m_s: float,
    **turn: float,
) -> Driver:
    phase = rng.uniform(0, 2 * math.pi)
    return Driver(number, kind, start, heading, speed_m_s, phase=phase, **turn)


def _is_free(one: Driver, others: list[Driver], seconds: float) -> bool:
    """Whether nobody is ever where it is."""
    for t_s in np.arange(0.0, seconds, 0.2):
        place = one.at(t_s)[0]
        for other in others:
            apart = CAR_APART_M if "Car" == one.kind[0] == other.kind[0] else PERSON_APART_M
            if float(np.hypot(*(other.at(t_s)[0] - place)[:2])) < apart:
                return False
    return True


def _in_view(
    drivers: list[Driver], t_s: float, T_map_camera: Pose
) -> tuple[list[TrueObject], dict[int, float]]:
    """Things in front of the camera, nearest first, and how much is seen of each."""
    T = T_map_camera.inverse()
    found = []
    for one in drivers:
        place, heading, velocity = one.at(t_s)
        c, s = math.cos(heading), math.sin(heading)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0, 0, 1.0]])
        pose = T @ Pose.from_rotation("map", "box", R, place)
        box = Box3D(pose, *one.kind[1])
        if not 2.0 < pose.translation_m[2] < TO_M + 15.0:
            continue
        outline = outline_px(box, CAMERA)
        if outline is not None and outline[2] > 0 and outline[0] < WIDTH - 1:
            found.append((one.number, box, T.matrix[:3, :3] @ velocity, outline))
    found.sort(key=lambda each: each[1].pose.translation_m[2])
    taken = np.zeros((HEIGHT // CELL_PX, WIDTH // CELL_PX), bool)
    truth, shares = [], {}
    for number, box, velocity, (left, top, right, bottom) in found:
        area = max(1.0, (right - left) * (bottom - top) / CELL_PX**2)
        rows = slice(max(0, int(top / CELL_PX)), max(0, math.ceil(bottom / CELL_PX)))
        columns = slice(max(0, int(left / CELL_PX)), max(0, math.ceil(right / CELL_PX)))
        cells = taken[rows, columns]
        share = min(1.0, float(np.count_nonzero(~cells)) / area) if cells.size else 0.0
        cells[:] = True
        shares[number] = share
        near = box.pose.translation_m[2] < TO_M
        truth.append(TrueObject(number, box, velocity, seen=share > LEAST_SEEN and bool(near)))
    return truth, shares


def _measured(
    name: str, box: Box3D, errors: Errors, staying: tuple[float, float], noise: Float64
) -> Obstacle:
    """The box as stereo sees it; `staying` are errors of its distance, its own and the rig's."""
    centre = box.pose.translation_m
    range_m = float(np.linalg.norm(centre))
    metres_per_px = float(centre[2]) * range_m / (FOCAL_PX * BASELINE_M)
    sigma_ray = errors.disparity_px * metres_per_px + 1e-3
    shared_m = errors.rig_px * metres_per_px
    sigma_across = 0.1
    ray = centre / range_m
    lasting, rig = staying
    own = math.sqrt(1 - errors.persistent) * noise[0] + math.sqrt(errors.persistent) * lasting
    off_m = math.sqrt(sigma_ray**2 - shared_m**2) * own + shared_m * rig
    sideways = np.array([ray[2], 0.0, -ray[0]]) / math.hypot(ray[0], ray[2])
    off = off_m * ray + sigma_across * noise[1] * sideways
    off = off + sigma_across * noise[2] * np.array([0.0, 1.0, 0.0])
    c, s = math.cos(0.08 * noise[3]), math.sin(0.08 * noise[3])
    R = box.pose.matrix[:3, :3] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0, 0, 1.0]])
    along = (R.T @ ray)[:2]
    sigma = [math.sqrt(sigma_ray**2 * a**2 + sigma_across**2 * (1 - a**2)) for a in along.tolist()]
    size = np.array([box.length_m, box.width_m, box.height_m]) * (1 + 0.05 * noise[4:7])
    seen = Box3D(
        Pose.from_rotation("camera_left", "box", R, centre + off),
        *(float(m) for m in size),
        np.array([*sigma, sigma_across, *(0.05 * size)]),
    )
    outline = outline_px(box, CAMERA)
    assert outline is not None  # it was in view
    left, top, right, bottom = outline
    box_px = (max(0.0, left), max(0.0, top), min(WIDTH - 1.0, right), min(HEIGHT - 1.0, bottom))
    distance_m = max(0.5, float(seen.corners_m()[:, 2].min()))
    detection = Detection(name, box_px)
    return Obstacle(detection, distance_m, sigma_ray, seen, 0.08, sigma_shared_m=shared_m)


def _false(rng: np.random.Generator, errors: Errors, rig: float) -> Obstacle:
    z = rng.uniform(8.0, 50.0)
    centre = np.array([rng.uniform(-0.6, 0.6) * z, 0.8, z])
    R = R_BODY_OPTICAL.T
    box = Box3D(Pose.from_rotation("camera_left", "box", R, centre), *CAR[1])
    return _measured("Car", box, errors, (rng.standard_normal(), rig), rng.standard_normal(10))


def _direction(heading: float) -> Float64:
    return np.array([math.cos(heading), math.sin(heading)])
