"""Where in a picture boards were seen, and where to hold the board next."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.structures.arrays import Float64, Int64

# Cells that a picture is divided into, columns and rows.
CELLS = (8, 6)
# Names of the thirds of a picture.
ACROSS, DOWN = ("left", "middle", "right"), ("top", "middle", "bottom")


@dataclass(frozen=True, eq=False)
class Coverage:
    """How many corners lie in each cell of a picture.

    Args:
        counts: (rows, columns) int64.
    """

    counts: Int64

    @classmethod
    def of(cls, seen: Iterable[Corners], size_px: tuple[int, int]) -> Self:
        """Of the corners in pictures of (width, height)."""
        every = [corners.uv for corners in seen]
        uv: Float64 = np.concatenate(every) if every else np.zeros((0, 2))
        columns, rows = CELLS
        counts, _, _ = np.histogram2d(
            uv[:, 1],
            uv[:, 0],
            bins=(rows, columns),
            range=((-0.5, size_px[1] - 0.5), (-0.5, size_px[0] - 0.5)),
        )
        return cls(counts.astype(np.int64))

    @property
    def share(self) -> float:
        """Share of the cells in which a corner was seen."""
        return float((self.counts > 0).mean())

    @property
    def emptiest(self) -> str:
        """The third by third of the picture that has most cells without corners; "" for none."""
        rows, columns = self.counts.shape
        row = np.arange(rows) * len(DOWN) // rows
        column = np.arange(columns) * len(ACROSS) // columns
        empty = np.zeros((len(DOWN), len(ACROSS)))
        for i in range(len(DOWN)):
            for j in range(len(ACROSS)):
                empty[i, j] = (self.counts[np.ix_(row == i, column == j)] == 0).mean()
        if not empty.any():
            return ""
        i, j = divmod(int(np.argmax(empty)), len(ACROSS))
        words = dict.fromkeys((DOWN[i], ACROSS[j]))
        return " ".join(words)
