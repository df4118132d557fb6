"""Whether given maps are in the unit they are read in: asked of the pictures themselves.

The right picture is looked up where each reading puts the points of the left one. The right
reading finds the same texture there; the others find anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import MapScale
from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.stereo.given_maps import UNITS, GivenMaps, MapKind, readable
from pseudolidar.structures.arrays import Float32, Float64, Int64
from pseudolidar.structures.frame import StereoFrame

# Steps that programs store: as they are, OpenCV, KITTI, centimetres, millimetres, TUM.
READINGS: dict[MapKind, tuple[float, ...]] = {
    "disparity": (1.0, 16.0, 256.0),
    "depth": (1.0, 100.0, 256.0, 1000.0, 5000.0),
}
# Points that are looked up, and the reach of the texture around each, px.
MAX_POINTS, REACH_PX = 2000, 3
# Grey levels that a point must differ from its neighbours: without texture any place fits.
LEAST_CONTRAST = 12.0
LEAST_POINTS = 100
# Error of a lookup as a share of chance. Measured 2026-11-25 on KITTI stereo 2015, raw, odometry,
# Middlebury and rendered worlds, of ground truth and of matches: the right reading has 0.16 to
# 0.53, readings off by a factor of 4 to 256 have 0.93 to 1.00; 0.87 on smooth textures at
# disparities of a few pixels.
WRONG_ERROR, RIGHT_ERROR = 0.7, 0.6
# Above this the maps lead nowhere in any reading.
UNRELATED_ERROR = 0.85


@dataclass(frozen=True)
class Verdict:
    """How well a reading fits the pictures.

    Args:
        steps: the reading in use.
        error: of it, as a share of chance; NaN where the pictures cannot tell.
        points: points that were looked up.
    """

    steps: float
    error: float
    points: int

    def text(self, kind: MapKind) -> str:
        """One line for people."""
        read = f"{kind} maps: {self.steps:g} steps a {UNITS[kind]}"
        if math.isnan(self.error):
            return f"{read}, not checked: only {self.points} points with texture"
        return f"{read}, error {self.error:.2f} of chance at {self.points} points of the pictures"


def check_readings(maps: GivenMaps, frames: Iterable[StereoFrame]) -> Verdict | None:
    """Compare the reading in use with the others on a few frames; None without a readable map.

    Raises:
        MapScale: another reading fits the pictures clearly better, or none does.
    """
    steps, lookups = None, dict[float, list[Float64]]()
    for frame in frames:
        stored = readable(maps, frame)
        if stored is None:
            continue
        steps = maps.steps(stored, maps.path_of(frame))
        rows, columns = _textured(frame, stored.values)
        for reading in {steps, *READINGS[maps.kind]}:
            d = maps.disparities(frame, stored, reading)[rows, columns]
            lookups.setdefault(reading, []).append(lookup_errors(frame, rows, columns, d))
    if steps is None:
        return None
    errors = {r: np.concatenate(parts) for r, parts in lookups.items()}
    points = len(errors[steps])
    if points < LEAST_POINTS:
        return Verdict(steps, float("nan"), points)
    medians = {reading: float(np.median(found)) for reading, found in errors.items()}
    best = min(medians, key=lambda reading: medians[reading])
    if medians[steps] > WRONG_ERROR and medians[best] < RIGHT_ERROR:
        unit = UNITS[maps.kind]
        raise MapScale(
            f"read with {steps:g} steps a {unit}, the {maps.kind} maps do not fit the pictures "
            f"(error {medians[steps]:.2f} of chance); with {best:g} they do ({medians[best]:.2f})",
            want="maps that lead from the left picture to the same place in the right one",
            fix=f"Pass --map-scale {best:g}.",
            path=maps.place,
        )
    if medians[steps] > UNRELATED_ERROR:
        raise MapScale(
            f"in no known scale do the {maps.kind} maps fit the pictures (error "
            f"{medians[steps]:.2f} of chance)",
            want="maps that lead from the left picture to the same place in the right one",
            fix="Are they of other frames, of the right eye, or depth in place of disparity? "
            "--map-scale says another scale, --no-check-maps takes them as they are.",
            path=maps.place,
        )
    return Verdict(steps, medians[steps], points)


def _textured(frame: StereoFrame, values: Float32) -> tuple[Int64, Int64]:
    """Rows and columns of points with a value and vertical edges, at most `MAX_POINTS`."""
    left = grey8_pair(frame.left, frame.right)[0].astype(np.float32)
    contrast = np.zeros_like(left)
    contrast[:, 1:-1] = np.abs(left[:, 2:] - left[:, :-2])
    inside = np.zeros(left.shape, bool)
    inside[REACH_PX:-REACH_PX, REACH_PX:-REACH_PX] = True
    rows, columns = np.nonzero(inside & (contrast > LEAST_CONTRAST) & np.isfinite(values))
    step = max(1, len(rows) // MAX_POINTS)
    return rows[::step], columns[::step]


def lookup_errors(frame: StereoFrame, rows: Int64, columns: Int64, d: Float32) -> Float64:
    """(N,) difference of the textures around points and where their disparity leads.

    Brightness is taken off each. What leads out of the picture counts as chance.

    Returns:
        Mean absolute difference as a share of that to texture drawn at random, about 0 to 1.
    """
    left, right = (eye.astype(np.float64) for eye in grey8_pair(frame.left, frame.right))
    width = left.shape[1]
    target = columns - d.astype(np.float64)
    seen = (target >= REACH_PX) & (target < width - 1 - REACH_PX)
    x = np.where(seen, target, REACH_PX)
    reach = np.arange(-REACH_PX, REACH_PX + 1)
    dy, dx = (offset.ravel() for offset in np.meshgrid(reach, reach, indexing="ij"))
    mine = left[rows[:, None] + dy, columns[:, None] + dx]
    at = np.floor(x).astype(np.int64)
    share = (x - at)[:, None]
    near = right[rows[:, None] + dy, at[:, None] + dx]
    next_to = right[rows[:, None] + dy, at[:, None] + dx + 1]
    theirs = near * (1 - share) + next_to * share
    mine -= mine.mean(axis=1, keepdims=True)
    theirs -= theirs.mean(axis=1, keepdims=True)
    own, other = np.abs(mine).mean(axis=1), np.abs(theirs).mean(axis=1)
    # Two unrelated textures differ by about the root of the sum of squares of their contrasts.
    chance = np.sqrt(own**2 + other**2)
    error = np.abs(mine - theirs).mean(axis=1) / np.maximum(chance, 1e-9)
    return np.where(seen, error, 1.0)
