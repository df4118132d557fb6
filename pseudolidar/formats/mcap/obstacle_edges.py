"""Obstacles as points on the edges of their boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pseudolidar.formats.mcap.items import Points
from pseudolidar.formats.obstacle_words import colour_by_distance
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import BOX_EDGES, Box3D
from pseudolidar.structures.obstacle import Obstacle

# Points along an edge of a box.
ALONG_EDGE = 25
# Alpha of what is only predicted, of 255.
PALE = 90


def edge_points(obstacles: Sequence[Obstacle], frame: str) -> Points:
    """Points along the edges of the boxes, coloured: for viewers that have clouds and no boxes.

    Columns: x, y, z, red, green, blue, alpha, `object` (identity of the track, else number in the
    frame), `distance_m`, `sigma_distance_m`, `coasting` (1 where it is only predicted; paler).
    """
    along = np.linspace(0.0, 1.0, ALONG_EDGE)[:, None]
    xyz = [
        np.concatenate([a + along * (b - a) for a, b in _edges(obstacle.box)])
        for obstacle in obstacles
    ]
    each = len(BOX_EDGES) * ALONG_EDGE
    points = np.concatenate(xyz) if xyz else np.zeros((0, 3))
    colours = np.array([colour_by_distance(one.distance_m) for one in obstacles], np.uint8)
    colours = colours.reshape(-1, 3).repeat(each, axis=0)
    names = [number_of(one, number) for number, one in enumerate(obstacles, start=1)]
    coasting = [one.coasts for one in obstacles]
    distances = [one.distance_m for one in obstacles]
    sigmas = [one.sigma_distance_m for one in obstacles]
    columns = {
        **dict(zip("xyz", points.astype(np.float32).T, strict=True)),
        **dict(zip(("red", "green", "blue"), colours.T, strict=True)),
        "alpha": np.array([PALE if one else 255 for one in coasting], np.uint8).repeat(each),
        "object": np.array(names, np.int32).repeat(each),
        "distance_m": np.array(distances, np.float32).repeat(each),
        "sigma_distance_m": np.array(sigmas, np.float32).repeat(each),
        "coasting": np.array(coasting, np.uint8).repeat(each),
    }
    return Points(columns, frame)


def number_of(obstacle: Obstacle, number: int) -> int:
    """Identity of its track, else its number in the frame."""
    return number if obstacle.track is None else obstacle.track.track_id


def _edges(box: Box3D) -> list[tuple[Float64, Float64]]:
    corners = box.corners_m()
    return [(corners[a], corners[b]) for a, b in BOX_EDGES]
