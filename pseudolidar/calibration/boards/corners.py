"""What one eye sees of a board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64, Int64, check_array


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a board in a picture.

    Args:
        ids: (N,) int64, which of the board's corners.
        uv: (N, 2) float64 px.
    """

    ids: Int64
    uv: Float64

    def __post_init__(self) -> None:
        check_array("Corners", "ids", self.ids, (None,), np.int64)
        check_array("Corners", "uv", self.uv, (len(self.ids), 2), np.float64)

    def __len__(self) -> int:
        return len(self.ids)
