"""Points of the scene that both eyes see at two times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Bool, Float64, Int64, check_array


@dataclass(frozen=True, eq=False)
class PointTracks:
    """Points followed from one pair to another, as columns; disparities as measured.

    Args:
        uv_from: (N, 2) float64 px in the left image of the first pair.
        d_from: (N,) float64 px, its disparity there.
        uv_to: (N, 2) float64 px in the left image of the second pair.
        d_to: (N,) float64 px, its disparity there.
    """

    uv_from: Float64
    d_from: Float64
    uv_to: Float64
    d_to: Float64

    def __post_init__(self) -> None:
        check_array("PointTracks", "d_from", self.d_from, (None,), np.float64)
        n = len(self.d_from)
        check_array("PointTracks", "uv_from", self.uv_from, (n, 2), np.float64)
        check_array("PointTracks", "uv_to", self.uv_to, (n, 2), np.float64)
        check_array("PointTracks", "d_to", self.d_to, (n,), np.float64)

    def __len__(self) -> int:
        return len(self.d_from)

    def __getitem__(self, index: Bool | Int64 | slice) -> PointTracks:
        """The chosen points."""
        return PointTracks(
            self.uv_from[index], self.d_from[index], self.uv_to[index], self.d_to[index]
        )
