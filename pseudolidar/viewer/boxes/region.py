"""A box in the scene, turned as one likes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.geometry.twists import inverted
from pseudolidar.structures.arrays import AnyArray, Bool, Float64
from pseudolidar.structures.box import BOX_EDGES

# Room about two corners that were clicked, m, so that noise of what they lie on is in the box.
MARGIN_M = 0.2
LEAST_M, MOST_M = 0.02, 500.0
# Corners of a box of edges of 1 about its middle, in the order that `BOX_EDGES` names.
CORNERS = (np.arange(8)[:, None] >> np.arange(3) & 1) - 0.5


@dataclass(frozen=True, eq=False)
class Region:
    """All places within a box.

    Args:
        T_local_box: (4, 4) where its middle is, and how it is turned, in the map relative to the
            origin of the scene.
        size_m: (3,) lengths along its own axes.
    """

    T_local_box: Float64
    size_m: Float64

    @classmethod
    def about(cls, place_m: Float64, size_m: Float64) -> Region:
        """Level, about a place (3,)."""
        T = np.eye(4)
        T[:3, 3] = place_m
        return cls(T, np.clip(size_m, LEAST_M, MOST_M))

    @classmethod
    def between(cls, one_m: Float64, other_m: Float64) -> Region:
        """Level, with two places (3,) in opposite corners, and room about them."""
        return cls.about(0.5 * (one_m + other_m), np.abs(one_m - other_m) + 2 * MARGIN_M)

    @property
    def turn_deg(self) -> float:
        """Of its first axis about the vertical."""
        return float(np.degrees(np.arctan2(self.T_local_box[1, 0], self.T_local_box[0, 0])))

    def turned(self, degrees: float) -> Region:
        """The same box, level, turned so far about the vertical."""
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return self._with(np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]]))

    def along(self, normal: Float64) -> Region:
        """The same box, turned as little as brings one of its axes to a direction (3,)."""
        R = self.T_local_box[:3, :3]
        axis = int(np.argmax(np.abs(R.T @ normal)))
        towards = normal * np.sign(R[:, axis] @ normal)
        cross, cosine = np.cross(R[:, axis], towards), float(R[:, axis] @ towards)
        K = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
        return self._with((np.eye(3) + K + K @ K / (1 + cosine)) @ R)

    def sized(self, size_m: Float64) -> Region:
        """The same box with other lengths."""
        return replace(self, size_m=np.clip(size_m, LEAST_M, MOST_M))

    def places(self, xyz: AnyArray, T_local_cloud: Float64) -> Float64:
        """(N, 3) points of a cloud along the axes of the box, from its middle."""
        T = inverted(self.T_local_box) @ T_local_cloud
        return np.asarray(xyz @ T[:3, :3].T + T[:3, 3])

    def holds(self, places: Float64) -> Bool:
        """(N,) which places (N, 3) along its axes are within."""
        return np.asarray((np.abs(places) <= 0.5 * self.size_m).all(axis=1))

    def sides(self, T_local_cloud: Float64) -> tuple[Float64, Float64]:
        """(6, 3) normals n to the inside and (6,) m d, in the frame of a cloud: n p + d >= 0."""
        T = inverted(self.T_local_box) @ T_local_cloud
        inside = np.concatenate([T[:3, :3], -T[:3, :3]])
        return inside, np.concatenate([T[:3, 3], -T[:3, 3]]) + np.tile(0.5 * self.size_m, 2)

    def edges(self) -> Float64:
        """(12, 2, 3) of the box, along its own axes from its middle."""
        corners = CORNERS * self.size_m
        return np.array([[corners[a], corners[b]] for a, b in BOX_EDGES])

    def _with(self, R: Float64) -> Region:
        T = self.T_local_box.copy()
        T[:3, :3] = R
        return replace(self, T_local_box=T)
