"""A cloud as seen from above, x ahead upwards, with rings of equal range."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from pseudolidar.evaluation.captions import write_on
from pseudolidar.evaluation.pictures import NOTHING, turbo
from pseudolidar.structures.arrays import AnyArray, Bool, Float64, Int64, UInt8
from pseudolidar.structures.cloud import PointCloud

PointColour = Literal["photo", "height"]
RINGS = 4
RING, SENSOR = (84, 84, 92), (255, 255, 255)
# Dark surfaces would be lost on the dark ground.
DARKEST = 48
# Size of what is written at a ring, px.
RING_LABEL_PX = 34, 12


def birds_eye(
    cloud: PointCloud,
    *,
    side_px: int,
    ahead_m: float,
    all_round: bool,
    colour: PointColour,
    heights_m: tuple[float, float],
) -> UInt8:
    """(side, side, 3) RGB of a cloud from above; the sensor at the lower edge, or in the middle.

    Args:
        cloud: with x forward, y left, z up.
        side_px: width and height.
        ahead_m: how far it reaches ahead; to each side half as far, all round the same.
        all_round: the sensor in the middle.
        colour: of the points: of the photo, where they have any, or by height.
        heights_m: which are blue and red.
    """
    span_m = 2 * ahead_m if all_round else ahead_m
    per_px = span_m / side_px
    row = (ahead_m - cloud.xyz[:, 0]) / per_px
    column = (span_m / 2 - cloud.xyz[:, 1]) / per_px
    with np.errstate(invalid="ignore"):
        inside = (row >= 0) & (row < side_px) & (column >= 0) & (column < side_px)  # NaN is not
    cells = row[inside].astype(np.int64) * side_px + column[inside].astype(np.int64)
    sensor = (side_px // 2, round(ahead_m / per_px))
    picture = _ground(side_px, per_px, ahead_m, sensor)
    if len(cells):
        seen = np.bincount(cells, minlength=side_px**2) > 0
        photo = cloud.rgb[inside] if colour == "photo" and cloud.rgb is not None else None
        points = (
            turbo(_means(cells, cloud.xyz[inside, 2:], side_px)[seen, 0], *heights_m)
            if photo is None
            else _brightened(_means(cells, photo, side_px)[seen])
        )
        picture.reshape(-1, 3)[seen] = points
        _thicken(picture, seen.reshape(side_px, side_px))
    _labels(picture, per_px, ahead_m, sensor)
    return picture


def nice_length(length: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... that is not above `length`."""
    power = 10.0 ** math.floor(math.log10(length))
    return max(step * power for step in (1, 2, 5) if step * power <= length * (1 + 1e-9))


def _thicken(picture: UInt8, seen: Bool) -> None:
    """Give each point its free neighbours right and below: single pixels get lost in a video."""
    for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        free = seen[here] & ~seen[there]
        picture[there][free] = picture[here][free]
        seen[there] |= free


def round_length(length: float) -> float:
    """The smallest of 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, ... that is not below `length`."""
    power = 10.0 ** math.floor(math.log10(max(length, 1e-3)))
    steps = (1, 1.5, 2, 3, 4, 5, 6, 8, 10)
    return min(step * power for step in steps if step * power >= length * (1 - 1e-9))


def _means(cells: Int64, columns: AnyArray, side_px: int) -> Float64:
    """(side * side, C) mean of the (N, C) values of each cell."""
    counts = np.maximum(np.bincount(cells, minlength=side_px**2), 1)
    sums = [np.bincount(cells, column, minlength=side_px**2) for column in columns.T]
    return np.stack(sums, axis=1) / counts[:, None]


def _brightened(rgb: Float64) -> UInt8:
    return np.asarray(np.round(DARKEST + rgb * ((255 - DARKEST) / 255)), np.uint8)


def _radii_m(ahead_m: float) -> list[float]:
    step = nice_length(ahead_m / RINGS)
    return [step * (n + 1) for n in range(int(ahead_m / step + 1e-9))]


def _ground(side_px: int, per_px: float, ahead_m: float, sensor: tuple[int, int]) -> UInt8:
    import cv2

    picture = np.full((side_px, side_px, 3), NOTHING, np.uint8)
    for radius_m in _radii_m(ahead_m):
        cv2.circle(picture, sensor, round(radius_m / per_px), RING, 1, cv2.LINE_AA)
    return picture


def ring_labels(side_px: int, ahead_m: float) -> list[tuple[int, int, int, int]]:
    """Left, top, right, bottom of what is written at the rings of a view ahead, px.

    Args:
        side_px: its width and height.
        ahead_m: how far it reaches.
    """
    width, height = RING_LABEL_PX
    places = (
        _ring_place(radius_m, ahead_m / side_px, (side_px // 2, side_px))
        for radius_m in _radii_m(ahead_m)
    )
    return [(x, y - height, x + width, y + 2) for x, y in places]


def _ring_place(radius_m: float, per_px: float, sensor: tuple[int, int]) -> tuple[int, int]:
    up = round(radius_m / per_px)
    return sensor[0] + 5, max(sensor[1] - up + 14, 12)


def _labels(picture: UInt8, per_px: float, ahead_m: float, sensor: tuple[int, int]) -> None:
    import cv2

    cv2.circle(picture, sensor, 4, SENSOR, -1, cv2.LINE_AA)
    for radius_m in _radii_m(ahead_m):
        write_on(picture, f"{radius_m:g} m", _ring_place(radius_m, per_px, sensor), 0.42)
