"""Ground of the street: road, kerbs, pavements, gardens, and side streets."""

from __future__ import annotations

import numpy as np

from pseudolidar.sources.worlds.materials import Material
from pseudolidar.sources.worlds.meshes import Colour, Mesh, join, sheet
from pseudolidar.sources.worlds.road import RoadLine, texture_start

# The street is made piece by piece.
PIECE_M = 32.0
# Every so many pieces a side street crosses, in the middle of the piece: first here, then every.
CROSSING_EVERY, CROSSING_AT = 5, 2
CROSSING_AT_M, CROSSING_EVERY_M = (CROSSING_AT + 0.5) * PIECE_M, CROSSING_EVERY * PIECE_M
# Across the street, metres from its middle (left and right alike).
ROAD_EDGE_M, KERB_M, WALK_EDGE_M = 6.2, 6.35, 9.8
KERB_HEIGHT_M = 0.13
# Half width of a side street, and of its mouth between the pavements, metres.
SIDE_STREET_M, MOUTH_M = 4.2, 6.0
GREY: Colour = (0.115, 0.115, 0.118)
STONE: Colour = (0.30, 0.29, 0.27)
PAVING: Colour = (0.27, 0.26, 0.25)
GREEN: Colour = (0.09, 0.13, 0.045)


def is_crossing(piece: int) -> bool:
    """Whether a side street crosses in the middle of the piece."""
    return piece % CROSSING_EVERY == CROSSING_AT


def in_side_street(k: int, start_m: float, end_m: float) -> bool:
    """Whether something from `start_m` to `end_m` along the road stands in a side street."""
    middle = (k + 0.5) * PIECE_M
    reach = MOUTH_M + 1.0
    return is_crossing(k) and start_m < middle + reach and end_m > middle - reach


def ground(road: RoadLine, k: int) -> Mesh:
    """Strips along the street: road, kerbs, pavements, gardens, land behind."""
    start, end, middle = k * PIECE_M, (k + 1) * PIECE_M, (k + 0.5) * PIECE_M
    parts = [carriageway(road, (start, end))]
    for side in (1.0, -1.0):
        if not is_crossing(k):
            parts += verge(road, (start, end), side)
            continue
        parts += verge(road, (start, middle - MOUTH_M), side)
        parts += verge(road, (middle + MOUTH_M, end), side)
        parts += _side_street(road, middle, side)
    return join(parts)


def carriageway(road: RoadLine, span: tuple[float, float]) -> Mesh:
    """The road itself."""
    across = (-ROAD_EDGE_M, 0.0, ROAD_EDGE_M)
    return _strip(road, span, across, (-0.05, 0.0, -0.05), Material.ASPHALT, GREY)


def verge(
    road: RoadLine, span: tuple[float, float], side: float, *, land_to_m: float = 150.0
) -> list[Mesh]:
    """Kerb, pavement and land on one side, as far as `land_to_m` from the middle."""
    edge, kerb, walk, top = side * ROAD_EDGE_M, side * KERB_M, side * WALK_EDGE_M, KERB_HEIGHT_M
    far = (walk, *(side * min(n, land_to_m) for n in (14.0, 40.0, 150.0)))
    stone = _strip(road, span, (edge, edge, kerb), (-0.06, top, top), Material.PLAIN, STONE)
    paved = _strip(road, span, (kerb, walk), (top, top + 0.03), Material.PAVEMENT, PAVING)
    land = _strip(road, span, far, (top + 0.03, 0.3, 0.5, 2.5), Material.GRASS, GREEN)
    return [stone, paved, land]


def _side_street(road: RoadLine, middle: float, side: float) -> list[Mesh]:
    """Asphalt away from the road, its corners paved; its markings run along it."""
    edge, far = side * ROAD_EDGE_M, side * 150.0
    lane, mouth = SIDE_STREET_M, MOUTH_M
    heights = (-0.05, 0.05, 2.4)
    across = (edge, side * 14.0, far)
    span = (middle - lane, middle + lane)
    parts = [_strip(road, span, across, heights, Material.ASPHALT, GREY, along=middle)]
    for near, beyond in ((-mouth, -lane), (lane, mouth)):
        corner = (middle + near, middle + beyond)
        top = (0.04, 0.16, 2.5)
        parts.append(_strip(road, corner, across, top, Material.PAVEMENT, PAVING))
    return parts


def _strip(
    road: RoadLine,
    span: tuple[float, float],
    n: tuple[float, ...],
    z: tuple[float, ...],
    material: Material,
    colour: Colour,
    *,
    along: float | None = None,
) -> Mesh:
    """Ground from `span[0]` to `span[1]` along the road, through offsets `n` at heights `z`.

    Its texture lies along the road, or with `along` across it, around that place.
    """
    s = np.linspace(*span, max(2, round((span[1] - span[0]) / 2.0) + 1))
    S, N = np.meshgrid(s, np.array(n), indexing="ij")
    points = road.at(S.ravel(), N.ravel()).reshape(*S.shape, 3)
    points[..., 2] += np.array(z)
    up = np.broadcast_to(np.array(z), S.shape)
    seed, start = (1, along) if along is not None else texture_start(span[0])
    texture = np.stack([S - start, N, up] if along is None else [N, S - start, up], axis=-1)
    return sheet(points, material, colour, texture=texture, seed=seed)
