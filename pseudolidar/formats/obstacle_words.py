"""How an obstacle is told in a few words and a colour, the same wherever it is shown."""

from __future__ import annotations

import math

import numpy as np

from pseudolidar.structures.obstacle import Obstacle

# Below this sigma centimetres are told, m.
CENTIMETRES_BELOW_M = 0.1
# Speeds that are not this many sigmas from standing are not told; of things of no class, of which
# most stand, more.
SURELY_MOVES, SURELY_MOVES_UNNAMED = 2.0, 3.0
UNNAMED = frozenset(("thing", "obstacle"))
# Colours by distance, m: red is near, as in pictures of disparity. Between them in even ratios.
NEAR_COLOURS = (
    (4.0, (255, 64, 48)),
    (10.0, (255, 160, 32)),
    (20.0, (240, 230, 60)),
    (35.0, (90, 220, 90)),
    (60.0, (70, 190, 255)),
)


def name_text(obstacle: Obstacle) -> str:
    """Class, and identity where it is followed: `Car 7`."""
    name = obstacle.detection.name
    return name if obstacle.track is None else f"{name} {obstacle.track.track_id}"


def distance_text(obstacle: Obstacle) -> str:
    """Distance of the nearest face and one standard deviation: `20.0 +- 0.4 m`.

    Where nothing nearer is looked for: `3.0 m or nearer`.
    """
    digits = 2 if obstacle.sigma_distance_m < CENTIMETRES_BELOW_M else 1
    if obstacle.bound:
        return f"{obstacle.distance_m:.{digits}f} m or nearer"
    return f"{obstacle.distance_m:.{digits}f} +- {obstacle.sigma_distance_m:.{digits}f} m"


def speed_text(obstacle: Obstacle) -> str:
    """Speed, where it is known and surely one: `8.3 m/s`; else nothing."""
    return f"{obstacle.track.speed_m_s:.1f} m/s" if moves(obstacle) and obstacle.track else ""


def unseen_text(obstacle: Obstacle) -> str:
    """Since when it is only predicted: `unseen 0.4 s`; nothing for what is seen."""
    track = obstacle.track
    return f"unseen {track.unseen_s:.1f} s" if obstacle.coasts and track is not None else ""


def moves(obstacle: Obstacle) -> bool:
    """Whether it is believed to be followed, and its speed surely is one."""
    track = obstacle.track
    unnamed = obstacle.detection.name in UNNAMED
    sigmas = SURELY_MOVES_UNNAMED if unnamed else SURELY_MOVES
    return (
        track is not None
        and track.state != "tentative"
        and math.isfinite(track.speed_m_s)
        and track.speed_m_s > sigmas * track.sigma_speed_m_s  # False for NaN
    )


def words(obstacle: Obstacle) -> tuple[str, ...]:
    """Its lines: what it is, how far, and how fast where that is known; since when unseen."""
    lines = (
        name_text(obstacle),
        distance_text(obstacle),
        speed_text(obstacle),
        unseen_text(obstacle),
    )
    return tuple(line for line in lines if line)


def colour_by_distance(distance_m: float) -> tuple[int, int, int]:
    """Red, green, blue, 0-255: near is red, far is blue."""
    steps = np.log([distance for distance, _ in NEAR_COLOURS])
    at = math.log(distance_m)
    red, green, blue = (
        round(float(np.interp(at, steps, [colour[i] for _, colour in NEAR_COLOURS])))
        for i in range(3)
    )
    return red, green, blue
