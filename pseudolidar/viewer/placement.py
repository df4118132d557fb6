"""Where the scene, the map and the rig are to one another."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.twists import inverted
from pseudolidar.structures.arrays import Float64


class Placement:
    """Poses of the shown frame.

    Everything is relative to the first place that is shown, so that numbers on the wire are small
    wherever on Earth it is. To follow the rig, or a thing, is to move the map under it.
    """

    def __init__(self) -> None:
        self.follow = True
        self._origin_m: Float64 | None = None
        self._T_scene_local = self._T_local_rig = np.eye(4)
        self._pinned_m: Float64 | None = None
        self._shift_m = np.zeros(3)

    @property
    def origin_m(self) -> Float64:
        """(3,) the place in the map that all numbers on the wire are relative to."""
        return np.zeros(3) if self._origin_m is None else self._origin_m

    @property
    def settled(self) -> bool:
        """Whether there is an origin."""
        return self._origin_m is not None

    def settle(self, place_m: Float64) -> None:
        """Take a place (3,) of the map as the origin, unless there is one."""
        if self._origin_m is None:
            self._origin_m = place_m.copy()

    def local(self, T_map_forward: Float64 | None) -> Float64:
        """(4, 4) a pose in the map relative to the origin; of an unknown one that of the origin."""
        if T_map_forward is None:
            return np.eye(4)
        self.settle(T_map_forward[:3, 3])
        T = T_map_forward.copy()
        T[:3, 3] -= self.origin_m
        return T

    def move(self, T_map_forward: Float64 | None, followed_m: Float64 | None) -> None:
        """Go on to another frame.

        Args:
            T_map_forward: (4, 4) where its clouds are in the map; None where nobody knows.
            followed_m: (3,) in their frame, of a thing that is to stay where it is in the scene.
        """
        self._T_local_rig = self.local(T_map_forward)
        self._T_scene_local = inverted(self._T_local_rig) if self.follow else np.eye(4)
        if followed_m is not None:
            place = self.of_rig(followed_m)
            self._pinned_m = place if self._pinned_m is None else self._pinned_m
            self._shift_m = self._pinned_m - place
        self._T_scene_local[:3, 3] += self._shift_m

    @property
    def holds(self) -> bool:
        """Whether a thing is held in place."""
        return self._pinned_m is not None

    def let_go(self) -> None:
        """Hold nothing in place any more, from the next frame on."""
        self._pinned_m, self._shift_m = None, np.zeros(3)

    @property
    def T_local_rig(self) -> Float64:
        """(4, 4) maps the frame of the clouds into the map, relative to the origin."""
        return self._T_local_rig

    @property
    def T_scene_local(self) -> Float64:
        """(4, 4) maps places of the map, relative to the origin, into the scene."""
        return self._T_scene_local

    @property
    def T_local_map(self) -> Float64:
        """(4, 4) takes the origin from places of the map as they are in files."""
        T = np.eye(4)
        T[:3, 3] = -self.origin_m
        return T

    @property
    def T_scene_map(self) -> Float64:
        """(4, 4) maps places of the map, as they are in files, into the scene."""
        return np.asarray(self._T_scene_local @ self.T_local_map)

    @property
    def T_scene_rig(self) -> Float64:
        """(4, 4) maps the frame of the clouds into the scene."""
        return np.asarray(self._T_scene_local @ self._T_local_rig)

    def of_rig(self, xyz_m: Float64) -> Float64:
        """(3,) where a point (3,) of the frame of the clouds is in the scene."""
        return moved(self.T_scene_rig, xyz_m)


def inverse_ray(T: Float64, origin: Float64, direction: Float64) -> tuple[Float64, Float64]:
    """A line (3,), (3,) as it is before a (4, 4) pose moves it."""
    return T[:3, :3].T @ (origin - T[:3, 3]), T[:3, :3].T @ direction


def moved(T: Float64, place_m: Float64) -> Float64:
    """(3,) a place through a (4, 4) pose."""
    return np.asarray(T[:3, :3] @ place_m + T[:3, 3])
