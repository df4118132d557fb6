"""Things that stand or move in a world: houses, trees, poles, cars, persons.

Each function returns a mesh in the thing's own frame: x forward, y left, z up, z = 0 the ground.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import (
    Colour,
    Mesh,
    disc,
    from_faces,
    frustum,
    join,
    sphere,
    tube,
    turn_z,
)
from pseudolidar.structures.arrays import Float64

# Length, width, height of the passenger car, metres (a compact saloon).
CAR_SIZE_M = (4.3, 1.76, 1.48)
# Length (stride), width, height of a walking person, metres.
PERSON_SIZE_M = (0.74, 0.62, 1.74)
# Wires of a utility pole: left of its middle, and how far they hang, metres.
WIRE_OFFSETS_M, WIRE_SAG_M = (-0.7, 0.0, 0.7), 0.6
# Postures of one stride.
STRIDE_PHASES = 24

CAR_COLOURS: tuple[Colour, ...] = (
    (0.42, 0.43, 0.45), (0.05, 0.055, 0.06), (0.72, 0.72, 0.70), (0.30, 0.03, 0.03),
    (0.04, 0.09, 0.26), (0.16, 0.18, 0.20), (0.10, 0.20, 0.13), (0.50, 0.46, 0.36),
)  # fmt: skip
WALL_COLOURS: tuple[Colour, ...] = (
    (0.50, 0.44, 0.33), (0.62, 0.60, 0.55), (0.36, 0.15, 0.10), (0.55, 0.36, 0.24),
    (0.45, 0.47, 0.46), (0.58, 0.52, 0.28), (0.42, 0.22, 0.15), (0.66, 0.58, 0.50),
)  # fmt: skip
CLOTHES: tuple[Colour, ...] = (
    (0.35, 0.05, 0.05), (0.05, 0.08, 0.22), (0.45, 0.42, 0.36), (0.06, 0.16, 0.09), (0.5, 0.3,
    0.06),
)  # fmt: skip


@functools.cache
def car(colour: Colour) -> Mesh:
    """A saloon of `CAR_SIZE_M`, its middle over the origin."""
    half, side = CAR_SIZE_M[0] / 2, CAR_SIZE_M[1] / 2
    body = frustum(
        (-half, -side, 0.22),
        (half, side, 0.62),
        Material.PAINT,
        colour,
        inset=(-0.0, 0.0, 0.0, 0.0),
    )
    hood = frustum(
        (-half, -side, 0.62),
        (half, side, 0.93),
        Material.PAINT,
        colour,
        inset=(0.12, 0.35, 0.06, 0.06),
    )
    cabin = frustum(
        (-1.85, -side + 0.06, 0.93),
        (0.95, side - 0.06, CAR_SIZE_M[2]),
        Material.CABIN,
        colour,
        inset=(0.45, 0.72, 0.16, 0.16),
    )
    wheels = []
    for x in (-1.28, 1.32):
        for y in (-side + 0.02, side - 0.02):
            tyre = disc(0.32, Material.RUBBER, (0.02, 0.02, 0.02))
            hub = disc(0.19, Material.METAL, (0.35, 0.35, 0.36), sides=8)
            out = math.copysign(0.012, y)
            wheels += [tyre.placed((x, y - out, 0.32)), hub.placed((x, y, 0.32))]
            ring = np.array([[x, y - math.copysign(0.2, y), 0.32], [x, y - out, 0.32]])
            wheels.append(tube(ring, (0.32, 0.32), Material.RUBBER, (0.02, 0.02, 0.02), sides=12))
    return join([body, hood, cabin, *wheels])


def person(phase_rad: float, shirt: Colour, trousers: Colour) -> Mesh:
    """A walking person at a phase of the stride, one of `STRIDE_PHASES`."""
    return _person(
        round(phase_rad / (2 * math.pi) * STRIDE_PHASES) % STRIDE_PHASES, shirt, trousers
    )


@functools.cache
def _person(phase: int, shirt: Colour, trousers: Colour) -> Mesh:
    swing = 0.5 * math.sin(2 * math.pi * phase / STRIDE_PHASES)
    skin: Colour = (0.45, 0.28, 0.20)
    parts = [
        tube(
            np.array([[0, 0, 0.82], [0, 0, 1.05], [0, 0, 1.32], [0, 0, 1.44]], float),
            (0.15, 0.17, 0.19, 0.07),
            Material.CLOTH,
            shirt,
            sides=10,
        ),
    ]
    for side in (-1.0, 1.0):
        step = side * swing
        hip = np.array([0.0, 0.09 * side, 0.86])
        foot = hip + 0.83 * np.array([math.sin(0.62 * step), 0.0, -math.cos(0.62 * step)])
        knee = 0.5 * (hip + foot) + np.array([0.05, 0.0, 0.0])
        parts.append(
            tube(np.array([hip, knee, foot]), (0.1, 0.075, 0.055), Material.CLOTH, trousers)
        )
        shoulder = np.array([0.0, 0.22 * side, 1.36])
        hand = shoulder + 0.6 * np.array(
            [-math.sin(0.5 * step), 0.08 * side, -math.cos(0.5 * step)]
        )
        parts.append(tube(np.array([shoulder, hand]), (0.06, 0.04), Material.CLOTH, shirt))
    ball, faces = sphere(1)
    head = from_faces(ball * (0.10, 0.085, 0.125) + (0.0, 0.0, 1.61), faces, Material.CLOTH, skin)
    return join([*parts, head])


def tree(rng: np.random.Generator, *, height_m: float, levels: int = 3) -> Mesh:
    """A leafy tree: tapered trunk with boughs, crown of bumpy masses of leaves."""
    top = 0.42 * height_m
    lean = rng.uniform(-0.15, 0.15, 2)
    trunk = np.array(
        [[0, 0, -0.3], [0, 0, 0.3 * top], [*lean, top], [*(2 * lean), 1.5 * top]], float
    )
    bark: Colour = (0.13, 0.10, 0.075)
    thick = 0.03 * height_m
    parts = [tube(trunk, (1.25 * thick, thick, 0.8 * thick, 0.4 * thick), Material.BARK, bark)]
    green: Colour = (0.075 + 0.05 * rng.random(), 0.14 + 0.05 * rng.random(), 0.035)
    count = int(rng.integers(4, 7))
    for k in range(count):
        angle = 2 * np.pi * (k + rng.random()) / count
        out = height_m * (0.0 if k == 0 else rng.uniform(0.12, 0.2))
        centre = np.array(
            [
                out * np.cos(angle),
                out * np.sin(angle),
                height_m * (0.8 if k == 0 else rng.uniform(0.5, 0.72)),
            ]
        )
        parts.append(_leaves(rng, centre, height_m * rng.uniform(0.15, 0.21), green, levels))
    return join(parts)


def bush(rng: np.random.Generator, *, radius_m: float, levels: int = 2) -> Mesh:
    """A round shrub."""
    green: Colour = (0.06 + 0.05 * rng.random(), 0.12 + 0.05 * rng.random(), 0.04)
    return _leaves(rng, np.array([0.0, 0.0, 0.6 * radius_m]), radius_m, green, levels)


def _leaves(
    rng: np.random.Generator, centre: Float64, radius_m: float, colour: Colour, levels: int
) -> Mesh:
    ball, faces = sphere(levels)
    waves = rng.normal(0.0, 1.0, (10, 3)) * np.linspace(1.5, 9.0, 10)[:, None]
    bumps = np.sin(ball @ waves.T + rng.uniform(0, 6.28, 10)) / np.linspace(1.0, 2.2, 10)
    radius = radius_m * (1.0 + 0.13 * bumps.sum(axis=1) / 2.0 + rng.normal(0, 0.05, len(ball)))
    points = ball * radius[:, None] * (1.15, 1.15, 0.9) + centre
    return from_faces(points, faces, Material.LEAF, colour, seed=int(rng.integers(1 << 20)))


def house(
    rng: np.random.Generator, *, front_m: float, depth_m: float, storeys: int, seed: int
) -> Mesh:
    """A house, its front wall along x (0 to `front_m`) at y = 0, its body towards +y."""
    wall = WALL_COLOURS[int(rng.integers(len(WALL_COLOURS)))]
    high = 2.9 * storeys + 0.3
    body = frustum((0, 0, -1.5), (front_m, depth_m, high), Material.FACADE, wall, seed=seed)
    tiles: Colour = ((0.24, 0.075, 0.05), (0.10, 0.10, 0.11), (0.19, 0.10, 0.07))[seed % 3]
    rise = 0.32 * depth_m if rng.random() < 0.85 else 0.4
    over = 0.35
    roof = _gable(-over, front_m + over, -over, depth_m + over, high - 0.1, rise, tiles, seed)
    gables = _gable_ends(front_m, depth_m, high, rise * depth_m / (depth_m + 2 * over), wall, seed)
    gutter = tube(
        np.array([[-over, -over, high - 0.12], [front_m + over, -over, high - 0.12]]),
        (0.07, 0.07),
        Material.METAL,
        (0.3, 0.3, 0.3),
        sides=6,
    )
    parts = [body, roof, gables, gutter]
    if rng.random() < 0.7:
        x = rng.uniform(0.2, 0.8) * front_m
        y = 0.6 * depth_m
        parts.append(
            frustum(
                (x, y, high),
                (x + 0.7, y + 0.7, high + rise + 0.8),
                Material.BRICK,
                (0.3, 0.13, 0.09),
            )
        )
    if rng.random() < 0.5:
        pipe = np.array([[0.15, -0.06, 0.0], [0.15, -0.06, high]])
        parts.append(tube(pipe, (0.05, 0.05), Material.METAL, (0.25, 0.25, 0.25), sides=6))
    return join(parts)


def _gable(
    x0: float, x1: float, y0: float, y1: float, z: float, rise: float, colour: Colour, seed: int
) -> Mesh:
    mid = 0.5 * (y0 + y1)
    points = np.array(
        [
            [x0, y0, z],
            [x1, y0, z],
            [x1, mid, z + rise],
            [x0, mid, z + rise],
            [x0, y1, z],
            [x1, y1, z],
        ]
    )
    slope = math.hypot(mid - y0, rise)
    texture = points.copy()
    texture[:, 1] = [0, 0, slope, slope, 2 * slope, 2 * slope]
    texture[:, 2] = 0.0
    faces = [(0, 1, 2), (0, 2, 3), (3, 2, 5), (3, 5, 4)]
    return from_faces(points, faces, Material.ROOF, colour, texture=texture, seed=seed)


def _gable_ends(x: float, y: float, z: float, rise: float, colour: Colour, seed: int) -> Mesh:
    points = np.array(
        [[0, 0, z], [0, y, z], [0, y / 2, z + rise], [x, 0, z], [x, y, z], [x, y / 2, z + rise]],
        float,
    )
    return from_faces(points, [(0, 1, 2), (3, 4, 5)], Material.BRICK, colour, seed=seed)


def lamp_post(height_m: float = 6.0) -> Mesh:
    """A street lamp; its arm reaches to +y."""
    grey: Colour = (0.16, 0.17, 0.17)
    post = tube(
        np.array([[0, 0, -0.3], [0, 0, 1.2], [0, 0, height_m]], float),
        (0.1, 0.075, 0.05),
        Material.METAL,
        grey,
    )
    arm = tube(
        np.array([[0, 0, height_m - 0.05], [0, 1.1, height_m + 0.12]]),
        (0.04, 0.03),
        Material.METAL,
        grey,
        sides=6,
    )
    head = frustum(
        (-0.12, 0.9, height_m + 0.06), (0.12, 1.5, height_m + 0.2), Material.METAL, (0.4, 0.4, 0.4)
    )
    return join([post, arm, head])


def sign_post(rng: np.random.Generator) -> Mesh:
    """A road sign that faces -x."""
    post = tube(
        np.array([[0, 0, -0.2], [0, 0, 2.5]], float),
        (0.03, 0.03),
        Material.METAL,
        (0.35, 0.35, 0.36),
        sides=6,
    )
    colour: Colour = ((0.5, 0.02, 0.02), (0.02, 0.08, 0.4))[int(rng.integers(2))]
    plate = disc(0.3, Material.SIGN, colour, sides=20).placed((-0.04, 0.0, 2.2), yaw_rad=np.pi / 2)
    return join([post, plate])


def utility_pole(height_m: float = 7.5) -> Mesh:
    """A wooden pole with a cross-arm along y for wires."""
    wood: Colour = (0.16, 0.12, 0.09)
    post = tube(
        np.array([[0, 0, -0.3], [0, 0, height_m]], float), (0.13, 0.09), Material.BARK, wood
    )
    arm = frustum((-0.05, -0.8, height_m - 0.5), (0.05, 0.8, height_m - 0.38), Material.BARK, wood)
    return join([post, arm])


def wires(ends: Sequence[tuple[Float64, float]], *, radius_m: float = 0.016) -> Mesh:
    """Three hanging wires between two utility poles, each a place (3,) and a heading, rad."""
    parts = []
    for offset in WIRE_OFFSETS_M:
        start, end = (turn_z(yaw, place)[:3] @ (0.0, offset, 7.15, 1.0) for place, yaw in ends)
        share = np.linspace(0.0, 1.0, 13)[:, None]
        path = start + share * (end - start)
        path[:, 2] -= WIRE_SAG_M * (4 * share * (1 - share))[:, 0]
        radii = np.full(13, radius_m)
        parts.append(tube(path, radii, Material.RUBBER, (0.03, 0.03, 0.03), sides=4))
    return join(parts)
