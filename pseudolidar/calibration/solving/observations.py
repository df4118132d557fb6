"""Corners of a board in the views of one or two eyes, laid out for solvers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.structures.arrays import Bool, Float64, Int64

# A pose of a plane needs four corners; two more make it one that can be judged.
LEAST_CORNERS = 6


@dataclass(frozen=True, eq=False)
class Observations:
    """Where V views of a board showed its N corners to E eyes.

    Args:
        points_m: (N, 3) float64, corners in the board's frame, m.
        uv: (V, E, N, 2) float64 px; 0 where not seen.
        seen: (V, E, N) bool.
    """

    points_m: Float64
    uv: Float64
    seen: Bool

    @classmethod
    def of(cls, points_m: Float64, views: Sequence[Sequence[Corners | None]]) -> Observations:
        """Lay out corners: for each view what each eye saw of a board with corners (N, 3)."""
        eyes = len(views[0]) if views else 0
        uv = np.zeros((len(views), eyes, len(points_m), 2))
        seen = np.zeros((len(views), eyes, len(points_m)), np.bool_)
        for v, view in enumerate(views):
            for e, corners in enumerate(view):
                if corners is not None:
                    uv[v, e, corners.ids], seen[v, e, corners.ids] = corners.uv, True
        return cls(points_m, uv, seen)

    def __len__(self) -> int:
        return len(self.seen)

    @property
    def enough(self) -> Bool:
        """(V, E) where an eye saw enough for a pose."""
        return np.asarray(self.seen.sum(axis=-1) >= LEAST_CORNERS, np.bool_)

    @property
    def in_both(self) -> Bool:
        """(V,) views of which every eye saw enough for a pose."""
        return np.asarray(self.enough.all(axis=-1))

    def of_eye(self, eye: int) -> Observations:
        """Those of one eye alone."""
        part = slice(eye, eye + 1)
        return replace(self, uv=self.uv[:, part], seen=self.seen[:, part])

    def of_views(self, views: Int64 | Bool) -> Observations:
        """Those of some views."""
        return replace(self, uv=self.uv[views], seen=self.seen[views])

    def exchanged(self) -> Observations:
        """With the two eyes exchanged."""
        return replace(self, uv=self.uv[:, ::-1], seen=self.seen[:, ::-1])

    def without(self, corners: Bool) -> Observations:
        """Without the corners (V, E, N) that are marked."""
        return replace(self, seen=self.seen & ~corners)

    def turned(self, eye: int, ids: Sequence[Int64]) -> Observations:
        """What one eye saw, read another way: in view v corner i is called `ids[v][i]`."""
        uv, seen = self.uv.copy(), self.seen.copy()
        for view, names in enumerate(ids):
            uv[view, eye, names], seen[view, eye, names] = self.uv[view, eye], self.seen[view, eye]
        return replace(self, uv=uv, seen=seen)
