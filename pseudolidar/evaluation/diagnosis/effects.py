"""What causes make of the disparities: each alone, and all of them together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.structures.arrays import Float64

# Causes that alone make so many times the error that they make together cancel each other.
CANCELLING = 2.0
# Blocks nearer to the middle of the image than this, and farther, as shares of its width.
MIDDLE, SIDES = 1 / 6, 1 / 3


@dataclass(frozen=True)
class JointEffect:
    """Typical errors of blocks, medians over them.

    Args:
        alone_px: of the largest cause without the others, absolute.
        together_px: of all causes, absolute.
        middle_px: of all causes, signed, in the middle third of the columns; None without blocks.
        sides_px: the same in the outer sixth at either side.
    """

    alone_px: float
    together_px: float
    middle_px: float | None
    sides_px: float | None

    @classmethod
    def of(cls, parts: Float64, from_middle: Float64) -> JointEffect:
        """Of what each cause makes of each block.

        Args:
            parts: (N, n) error of N blocks by n causes, px.
            from_middle: (N,) columns of the blocks from the middle, as a share of the width.
        """
        sums = parts.sum(axis=1)
        places = from_middle < MIDDLE, from_middle > SIDES
        middle, sides = (float(np.median(sums[at])) if at.any() else None for at in places)
        alone = np.median(np.abs(parts), axis=0)
        return cls(
            float(alone.max(initial=0.0)),
            float(np.median(np.abs(sums))) if len(sums) else 0.0,
            middle,
            sides,
        )

    @property
    def cancels(self) -> bool:
        """Whether the causes take each other back for the most part: a sum of large differences.

        Then the data show the sum, and hardly how it is made up: calibrations trade, as an example,
        a wrong principal point against a wrong rotation.
        """
        return self.alone_px > CANCELLING * self.together_px

    @property
    def shape(self) -> str:
        """The sum over the columns of the image, in words; empty where nothing is known."""
        places = (
            ("in the middle of the image", self.middle_px),
            ("towards its sides", self.sides_px),
        )
        return ", ".join(f"{px:+.2f} px {where}" for where, px in places if px is not None)

    @property
    def text(self) -> str:
        """The sum in words, beside its parts."""
        shape = f" ({self.shape})" if self.shape else ""
        alone = f"alone they would make up to {self.alone_px:.1f} px"
        return f"{alone}, together {self.together_px:.2f} px{shape}"

    def as_dict(self) -> dict[str, Any]:
        """The fields, and whether causes cancel."""
        return {**vars(self), "cancels": self.cancels}
