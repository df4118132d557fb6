"""Obstacles drawn into a photo, and into a view from above."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.birds_eye import ring_labels
from pseudolidar.evaluation.free_place import Places, Rectangle
from pseudolidar.evaluation.lines_and_labels import FARTHEST_PX, draw_label, draw_lines
from pseudolidar.formats.obstacle_words import (
    colour_by_distance,
    distance_text,
    moves,
    name_text,
    speed_text,
    unseen_text,
)
from pseudolidar.geometry.lines_in_view import lines_px
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.box import BOX_EDGES, Box3D
from pseudolidar.structures.obstacle import Obstacle

ABOVE_TEXT_SIZE = 0.38
# Boxes nearer than this have thicker lines, m.
THICK_BELOW_M = 25.0
# An arrow is as long as the way of this time, s.
ARROW_S, ARROW_TIP = 1.0, 0.25
# What is only predicted has lines of dashes as long as the gaps between them, px.
DASH_PX = 6.0
BOTTOM_CORNERS = (0, 2, 6, 4)


@dataclass(frozen=True, eq=False)
class AboveView:
    """Where things are in a view from above.

    Args:
        side_px: its width and height.
        ahead_m: how far it reaches ahead; to each side half as far.
    """

    side_px: int
    ahead_m: float

    def pixels(self, xyz_m: Float64) -> Float64:
        """(N, 2) x, y in the picture of (N, 3) points in `camera_left`."""
        per_px = self.ahead_m / self.side_px
        ahead, right = xyz_m[:, 2], xyz_m[:, 0]
        return np.stack(
            [(self.ahead_m / 2 + right) / per_px, (self.ahead_m - ahead) / per_px], axis=1
        )


def draw_in_photo(
    photo: UInt8, obstacles: Sequence[Obstacle], K: Float64, *, scale: float = 1.0
) -> None:
    """Boxes and their edges in space, the near over the far, then labels that cover no other.

    Args:
        photo: (H, W, 3) RGB, changed.
        obstacles: in `camera_left`.
        K: (3, 3) of the photo at its own size.
        scale: size of `photo` in relation to that.
    """
    near_first = sorted(obstacles, key=lambda one: one.distance_m)
    for obstacle in reversed(near_first):
        colour = colour_by_distance(obstacle.distance_m)
        thick = 2 if obstacle.distance_m < THICK_BELOW_M else 1
        corners = _scaled(obstacle.detection.box_px, scale)
        sides = [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        draw_lines(photo, _styled(obstacle, sides, photo), colour, 1)
        draw_lines(
            photo, _styled(obstacle, _edges_px(obstacle.box, K, scale), photo), colour, thick
        )
    boxes = [_inside(_scaled(one.detection.box_px, scale), photo) for one in near_first]
    places = Places((photo.shape[1], photo.shape[0]), boxes)
    for obstacle, box in zip(near_first, boxes, strict=True):
        first = [name_text(obstacle), speed_text(obstacle), unseen_text(obstacle)]
        lines = ["  ".join(part for part in first if part), distance_text(obstacle)]
        draw_label(photo, places, lines, box, colour_by_distance(obstacle.distance_m))


def draw_from_above(picture: UInt8, obstacles: Sequence[Obstacle], view: AboveView) -> None:
    """Footprints, error bars along the ray, arrows of one second, and labels.

    Args:
        picture: (side, side, 3) RGB, changed.
        obstacles: in `camera_left`.
        view: of the picture.
    """
    near_first = sorted(obstacles, key=lambda one: one.distance_m)
    for obstacle in reversed(near_first):
        colour = colour_by_distance(obstacle.distance_m)
        corners = view.pixels(obstacle.box.corners_m()[list(BOTTOM_CORNERS)])
        sides = [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        draw_lines(picture, _styled(obstacle, sides, picture), colour, 2)
        draw_lines(picture, [_error_bar(obstacle, view)], (255, 255, 255), 1)
        _arrow(picture, obstacle, view, colour)
    shown = [one for one in near_first if _is_in(view, one)]
    footprints = [_around(view.pixels(one.box.corners_m())) for one in shown]
    spared = [*footprints, *ring_labels(view.side_px, view.ahead_m)]
    places = Places((picture.shape[1], picture.shape[0]), spared)
    for obstacle, beside in zip(shown, footprints, strict=True):
        name = "" if obstacle.track is None else f"{obstacle.track.track_id}:"
        speed = speed_text(obstacle)
        text = " ".join(part for part in (name, f"{obstacle.distance_m:.1f} m", speed) if part)
        colour = colour_by_distance(obstacle.distance_m)
        draw_label(picture, places, [text], beside, colour, size=ABOVE_TEXT_SIZE)


def _is_in(view: AboveView, obstacle: Obstacle) -> bool:
    (middle,) = view.pixels(obstacle.box.pose.translation_m[None])
    return bool((middle >= 0).all() and (middle < view.side_px).all())


def _around(corners: Float64) -> Rectangle:
    (left, top), (right, bottom) = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    return int(left), int(top), int(right), int(bottom)


def _scaled(box_px: tuple[float, float, float, float], scale: float) -> Float64:
    """(4, 2) corners of a box in the picture, around it."""
    left, top, right, bottom = (scale * (edge + 0.5) - 0.5 for edge in box_px)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _edges_px(box: Box3D, K: Float64, scale: float) -> list[tuple[Float64, Float64]]:
    """Ends of the edges in the picture, cut where they are behind the camera."""
    edges = lines_px(box.corners_m()[np.array(BOX_EDGES)], np.column_stack([K, np.zeros(3)]))
    return [(begin, end) for begin, end in scale * (edges + 0.5) - 0.5]


def _styled(
    obstacle: Obstacle, lines: Sequence[tuple[Float64, Float64]], picture: UInt8
) -> Sequence[tuple[Float64, Float64]]:
    """Whole lines of what is seen, dashes of what is only predicted."""
    return _dashes(lines, picture) if obstacle.coasts else lines


def _dashes(
    lines: Sequence[tuple[Float64, Float64]], picture: UInt8
) -> list[tuple[Float64, Float64]]:
    """Every other part of each line, as far as it is in the picture."""
    high, wide = picture.shape[:2]
    dashes = []
    for a, b in lines:
        count = max(math.ceil(float(np.linalg.norm(b - a)) / DASH_PX), 1)
        at = np.arange(0, count, 2)[:, None] / count
        begins, ends = a + at * (b - a), a + (at + 1 / count) * (b - a)
        shown = ((ends >= 0) & (begins < (wide, high))).all(axis=1)
        dashes += list(zip(begins[shown], ends[shown], strict=True))
    return dashes


def _error_bar(obstacle: Obstacle, view: AboveView) -> tuple[Float64, Float64]:
    """One standard deviation each way from the nearest face, along the ray; none behind the eye."""
    x, _, z = obstacle.box.pose.translation_m
    ends = [
        max(obstacle.distance_m + side * obstacle.sigma_distance_m, 0.0)
        * np.array([x / z, 0.0, 1.0])
        for side in (-1, 1)
    ]
    near, far = view.pixels(np.array(ends))
    return near, far


def _arrow(
    picture: UInt8, obstacle: Obstacle, view: AboveView, colour: tuple[int, int, int]
) -> None:
    import cv2

    track = obstacle.track
    if track is None or not moves(obstacle):
        return
    centre = obstacle.box.pose.translation_m
    begin, end = view.pixels(np.stack([centre, centre + ARROW_S * track.velocity_m_s]))
    cv2.arrowedLine(
        picture, _whole(begin), _whole(end), colour, 2, cv2.LINE_AA, tipLength=ARROW_TIP
    )


def _whole(point: Float64) -> tuple[int, int]:
    x, y = np.rint(np.clip(point, -FARTHEST_PX, FARTHEST_PX))
    return int(x), int(y)


def _inside(box: Float64, picture: UInt8) -> Rectangle:
    """The part of a box that is in the picture."""
    high, wide = picture.shape[:2]
    (left, top), (right, bottom) = np.rint(np.clip(box[[0, 2]], 0, (wide, high)))
    return int(left), int(top), int(right), int(bottom)
