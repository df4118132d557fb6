"""A bar of a round length that suits how far away somebody looks from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.structures.arrays import Float32, Float64
from pseudolidar.viewer.octree.chosen import Eye

# The bar is at most this share of the width of the view, and so many pieces long.
WIDTH_SHARE, PIECES = 0.25, 5
# It lies above the ground by this share of its length, so that points of the ground do not hide it.
ABOVE_SHARE = 0.03
# It turns by such steps, so that it lies still while a view turns little; degrees.
TURN_STEP_DEG = 15.0
# And moves by steps of this share of its length.
MOVE_SHARE = 0.02
# Its ends stand up by this share of its length, the marks between its pieces by half of that.
END_SHARE = 0.06
LEAST_M, MOST_M = 0.01, 1e6
ROUND = (1, 2, 5)


def round_length_m(most_m: float) -> float:
    """The longest of 1, 2 or 5 times a power of ten that is no longer."""
    power = 10.0 ** np.floor(np.log10(most_m))
    # Sizes that are themselves round lose nothing by rounding of floats.
    return float(power * max(step for step in ROUND if step * power <= most_m * (1 + 1e-9)))


def length_text(length_m: float) -> str:
    """In words, with the unit that people take for it."""
    if length_m >= 1000:
        return f"{length_m / 1000:g} km"
    return f"{length_m:g} m" if length_m >= 1 else f"{100 * length_m:g} cm"


@dataclass(frozen=True)
class Ruler:
    """A level bar in the scene.

    Args:
        middle_m: its middle.
        turn_deg: of the bar about the vertical, from x.
        length_m: round.
    """

    middle_m: tuple[float, float, float]
    turn_deg: float
    length_m: float

    @classmethod
    def before(cls, eye: Eye, look_at_m: Float64, level_m: float) -> Self:
        """Across the view of an eye, on the ground where it looks.

        Args:
            eye: in the scene.
            look_at_m: (3,) what it looks at.
            level_m: height of the ground in the scene.
        """
        middle = np.array([*look_at_m[:2], round(level_m, 2)])
        way_m = float(np.clip(np.linalg.norm(middle - eye.position_m), LEAST_M, MOST_M))
        wide_m = 2 * way_m * np.tan(0.5 * eye.fov) * eye.aspect
        length_m = round_length_m(WIDTH_SHARE * float(np.clip(wide_m, LEAST_M, MOST_M)))
        right = eye.R_world_eye[:, 0]
        turns = round(float(np.degrees(np.arctan2(right[1], right[0]))) / TURN_STEP_DEG)
        step_m = MOVE_SHARE * length_m
        x, y = (np.round(middle[:2] / step_m) * step_m).tolist()
        middle_m = x, y, float(middle[2]) + ABOVE_SHARE * length_m
        return cls(middle_m, turns * TURN_STEP_DEG, length_m)

    @property
    def pieces(self) -> Float32:
        """(P, 2, 3) parts of the bar, of the same length, one after the other."""
        places = self._at(np.linspace(-0.5, 0.5, PIECES + 1))
        return np.stack([places[:-1], places[1:]], axis=1)

    @property
    def marks(self) -> Float32:
        """(P + 1, 2, 3) what stands up between the parts and at the ends."""
        places = self._at(np.linspace(-0.5, 0.5, PIECES + 1))
        tops = places.copy()
        tops[:, 2] += 0.5 * END_SHARE * self.length_m
        tops[[0, -1], 2] += 0.5 * END_SHARE * self.length_m
        return np.stack([places, tops], axis=1)

    @property
    def ends(self) -> tuple[tuple[str, Float32], tuple[str, Float32]]:
        """What is written at its ends, and where (3,)."""
        zero, full = self.marks[[0, -1], 1]
        return ("0", zero), (length_text(self.length_m), full)

    def _at(self, shares: Float64) -> Float32:
        turn = np.radians(self.turn_deg)
        along = np.array([np.cos(turn), np.sin(turn), 0.0])
        places = np.array(self.middle_m) + shares[:, None] * self.length_m * along
        return np.asarray(places, np.float32)
