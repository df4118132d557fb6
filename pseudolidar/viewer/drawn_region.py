"""A box in the scene with handles to move and turn it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pseudolidar.geometry.quaternion import quaternion_wxyz, rotation_of
from pseudolidar.structures.arrays import Float64
from pseudolidar.viewer.boxes.region import Region
from pseudolidar.viewer.stage import MAP

COLOUR, LINE_PX = (255, 120, 220), 2.5
# Handles are as large as this share of the diagonal of the box, and are no smaller than this, m.
HANDLES_SHARE, LEAST_HANDLES_M = 0.4, 0.3
HANDLES_OPACITY = 0.8
# Boxes are moved no farther from the origin of the scene, m.
FARTHEST_M = 1e5


class DrawnRegion:
    """One box, whose node is made when it is first wanted, and changed in place.

    Args:
        scene: of viser.
        moved: called with the pose (4, 4) that somebody moved it to, in the map.
    """

    def __init__(self, scene: Any, moved: Callable[[Float64], None]) -> None:
        self._scene, self._moved = scene, moved
        self._handles: Any = None
        self._edges: Any = None
        self._frame: Any = None

    def show(self, region: Region | None, *, handles: bool) -> None:
        """Draw a box, with handles or without; or none."""
        if region is not None and self._frame is None:
            self._make(region)
        if self._frame is None:
            return
        self._frame.visible = region is not None
        self._handles.visible = region is not None and handles
        if region is None:
            return
        self._handles.scale = max(
            HANDLES_SHARE * float(np.linalg.norm(region.size_m)), LEAST_HANDLES_M
        )
        self._edges.points = region.edges().astype(np.float32)
        _place(self._frame, region)
        _place(self._handles, region)

    def follow(self, region: Region | None) -> None:
        """Move the box and not its handles, which somebody holds."""
        if region is not None and self._frame is not None:
            _place(self._frame, region)

    def _make(self, region: Region) -> None:
        reach = (-FARTHEST_M, FARTHEST_M)
        self._frame = self._scene.add_frame(f"{MAP}/region", show_axes=False)
        self._edges = self._scene.add_line_segments(
            f"{MAP}/region/edges", region.edges().astype(np.float32), COLOUR,
            thickness=LINE_PX, thickness_units="screen",
        )  # fmt: skip
        self._handles = self._scene.add_transform_controls(
            f"{MAP}/handles", translation_limits=(reach, reach, reach), depth_test=False,
            opacity=HANDLES_OPACITY,
        )  # fmt: skip
        self._handles.on_update(lambda _: self._drag())

    def _drag(self) -> None:
        wxyz = np.array(self._handles.wxyz, np.float64)
        T = np.eye(4)
        T[:3, :3] = rotation_of(wxyz / np.linalg.norm(wxyz))
        T[:3, 3] = np.clip(self._handles.position, -FARTHEST_M, FARTHEST_M)
        self._moved(T)


def _place(node: Any, region: Region) -> None:
    node.wxyz = quaternion_wxyz(region.T_local_box[:3, :3])
    node.position = region.T_local_box[:3, 3]
