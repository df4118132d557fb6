"""Where the eye of a film is, picture by picture: round a thing, along a path, behind a rig."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.evaluation.cloud_views import Eye
from pseudolidar.geometry.path_length import length_m
from pseudolidar.structures.arrays import Float32, Float64
from pseudolidar.viewer.filming.painted import evenly

# Pictures a second.
RATE_HZ = 25
# A turn takes so long, s; the eye looks down by this angle, and is so far away, as a share of the
# size of what it goes round.
TURN_S, DOWN_DEG, AWAY = 14.0, 28.0, 0.9
# Shares of the points that lie outside of what the eye goes round.
OUTSIDE = 0.03
# Along a path: how fast, m/s, for how long at least and at most, s.
SPEED_M_S, LEAST_S, MOST_S = 6.0, 6.0, 60.0
# The eye is so far behind and above a place, and looks so far ahead of it and so far above it, m.
BEHIND_M, ABOVE_M, AHEAD_M, UP_M = 2.5, 2.5, 14.0, -0.5
# What lies within this way of a path is averaged for its direction, m.
SMOOTH_M = 6.0
# The eye behind a rig comes after it within this time, s.
LAG_S = 0.5


def turntable(xyz: Float32) -> list[Eye]:
    """Once round a cloud.

    Args:
        xyz: (N, 3) of it, z up; at least one.
    """
    low, high = np.quantile(xyz, (OUTSIDE, 1 - OUTSIDE), axis=0)
    middle, size_m = 0.5 * (low + high), max(float(np.linalg.norm(high - low)), 1e-3)
    away_m, down = AWAY * size_m, np.radians(DOWN_DEG)
    turns = np.linspace(0, 2 * np.pi, round(TURN_S * RATE_HZ), endpoint=False)
    level = np.stack([np.cos(turns), np.sin(turns)], axis=1) * (-away_m * np.cos(down))
    up_m = away_m * float(np.sin(down))
    return [_eye(np.add(middle, (x, y, up_m)), middle) for x, y in level]


def along(places_m: Float64) -> list[Eye]:
    """From one end of a path to the other, at an even speed, behind and above it.

    Args:
        places_m: (N, 3) of it; at least two that are not the same.
    """
    way_m = length_m(places_m)
    count = round(float(np.clip(way_m / SPEED_M_S, LEAST_S, MOST_S)) * RATE_HZ)
    places = _smooth(evenly(places_m, count), way_m / count)
    steps = np.gradient(places, axis=0)
    return [behind(place, step) for place, step in zip(places, steps, strict=True)]


def behind(place_m: Float64, forward: Float64) -> Eye:
    """Behind and above a place, looking along a direction as far as that is level.

    Args:
        place_m: (3,).
        forward: (3,) of any length.
    """
    level = np.array([forward[0], forward[1], 0.0])
    length = float(np.linalg.norm(level))
    level = level / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    at = place_m - BEHIND_M * level + (0, 0, ABOVE_M)
    return _eye(at, place_m + AHEAD_M * level + (0, 0, UP_M))


@dataclass
class Chase:
    """An eye that comes after a rig smoothly.

    Args:
        eye: where it is; None before the first place.
    """

    eye: Eye | None = None

    def follow(self, target: Eye, seconds: float) -> Eye:
        """Where it is so long after the last call, when it should be at the target."""
        if self.eye is not None:
            target = between(self.eye, target, float(1 - np.exp(-seconds / LAG_S)))
        self.eye = target
        return target


def sized(eye: Eye, size_px: tuple[int, int]) -> Eye:
    """The same eye for pictures of another size (width, height)."""
    return replace(eye, width_px=size_px[0], height_px=size_px[1])


def between(one: Eye, other: Eye, share: float) -> Eye:
    """An eye on the way from one to another; at 1 it is there."""
    at, towards = (
        np.add(a, share * np.subtract(b, a))
        for a, b in ((one.at_m, other.at_m), (one.towards_m, other.towards_m))
    )
    moved = _eye(at, towards)
    return replace(other, at_m=moved.at_m, towards_m=moved.towards_m)


def _smooth(places: Float64, step_m: float) -> Float64:
    """Places averaged with those near them, so that the eye does not shake."""
    reach = min(round(SMOOTH_M / max(step_m, 1e-9)), (len(places) - 1) // 2)
    if reach < 1:
        return places
    # Ends go on as they begin: the average of a straight line is itself.
    before = 2 * places[0] - places[reach:0:-1]
    after = 2 * places[-1] - places[-2 : -reach - 2 : -1]
    weights = np.hanning(2 * reach + 3)[1:-1]
    longer = np.concatenate([before, places, after])
    columns = [np.convolve(axis, weights / weights.sum(), mode="valid") for axis in longer.T]
    return np.stack(columns, axis=1)


def _eye(at: Float64, towards: Float64) -> Eye:
    (x, y, z), (to_x, to_y, to_z) = at.tolist(), towards.tolist()
    return Eye((x, y, z), (to_x, to_y, to_z))
