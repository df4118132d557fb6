"""A road without end: its centre line, gentle bends and hills, and places beside it."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pseudolidar.structures.arrays import Float64

# The centre line is integrated in steps of this length and blocks of this many steps.
STEP_M = 0.25
BLOCK = 1024
# A multiple of the pieces that worlds are made of and of the road's dashes, metres.
TEXTURE_PERIOD_M = 1440.0
# Where the line starts, so that what lies behind the first frame is road too, metres.
BEFORE_START_M = 256.0


class RoadLine(Protocol):
    """A centre line, and places beside it."""

    def at(self, s_m: Float64, n_m: Float64) -> Float64:
        """(N, 3) world position `s_m` along, `n_m` to the left, on the height of the road."""

    def place(self, s_m: float, n_m: float) -> tuple[Float64, float]:
        """(3,) world position and heading (rad) of one spot."""


@dataclass(frozen=True)
class Road:
    """Heading and height are sums of sines of the arc length; any length costs the same a metre.

    Args:
        seed: which road.
        bend_rad: largest change of heading; hill_m: largest height.
    """

    seed: int
    bend_rad: float = 0.30
    hill_m: float = 0.9

    def heading_rad(self, s_m: Float64) -> Float64:
        """(N,) direction of the road at arc lengths (N,), left positive."""
        return self.bend_rad * _waves(s_m, self.seed, (410.0, 190.0))

    def height_m(self, s_m: Float64) -> Float64:
        """(N,) height of the road."""
        return self.hill_m * _waves(s_m, self.seed + 1, (260.0, 140.0))

    def slope_rad(self, s_m: Float64) -> Float64:
        """(N,) pitch of the road, up positive."""
        return np.arctan((self.height_m(s_m + 0.5) - self.height_m(s_m - 0.5)) / 1.0)

    def centre(self, s_m: Float64) -> Float64:
        """(N, 2) position of the centre line."""
        place = (s_m + BEFORE_START_M) / STEP_M
        step = np.floor(place).astype(np.int64)
        known = _line(self, int(step.max()) // BLOCK + 1)
        share = (place - step)[:, None]
        return known[step] * (1 - share) + known[step + 1] * share

    def at(self, s_m: Float64, n_m: Float64) -> Float64:
        """(N, 3) world position `s_m` along, `n_m` to the left, on the height of the road."""
        heading = self.heading_rad(s_m)
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        ground = self.centre(s_m) + n_m[:, None] * left
        return np.column_stack([ground, self.height_m(s_m)])

    def place(self, s_m: float, n_m: float) -> tuple[Float64, float]:
        """(3,) world position and heading (rad) of one spot."""
        s = np.array([s_m])
        return self.at(s, np.array([n_m]))[0], float(self.heading_rad(s)[0])


def texture_start(s_m: float) -> tuple[int, float]:
    """Seed and origin of the ground's texture at an arc length.

    Texture is in single precision: it starts anew before its coordinates get coarse.
    """
    period = int(np.floor(s_m / TEXTURE_PERIOD_M))
    return 1 + period, period * TEXTURE_PERIOD_M


def _waves(s_m: Float64, seed: int, lengths_m: tuple[float, ...]) -> Float64:
    phases = np.random.default_rng([seed, 77]).uniform(0, 2 * np.pi, len(lengths_m))
    parts = [np.sin(2 * np.pi * s_m / L + p) for L, p in zip(lengths_m, phases, strict=True)]
    return np.asarray(sum(parts) / len(lengths_m), dtype=np.float64)


@functools.lru_cache(maxsize=4)
def _line(road: Road, blocks: int) -> Float64:
    """(blocks * BLOCK + 1, 2) the centre line from -BEFORE_START_M on, by the midpoint rule."""
    middle = (np.arange(blocks * BLOCK, dtype=np.float64) + 0.5) * STEP_M - BEFORE_START_M
    heading = road.heading_rad(middle)
    steps = STEP_M * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    # cumsum adds in order, so a longer line starts with the same bits.
    return np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
