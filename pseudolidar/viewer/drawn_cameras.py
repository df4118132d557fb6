"""Frusta of the cameras, changed in place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.viewer.cameras import StandingCamera, cameras_of
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.stage import RIG

if TYPE_CHECKING:
    from pseudolidar.viewer.view import View

CAMERA_COLOUR = (240, 160, 30)


class DrawnCameras:
    """The cameras of the shown frame as pyramids: the left one with its photo, the right one bare.

    Args:
        view: what is looked at.
    """

    def __init__(self, view: View) -> None:
        self._server = view.server.viser
        self._nodes: dict[str, Any] = {}
        self._there: frozenset[str] = frozenset()
        self._visible = True
        view.on_shown(self._show)

    @property
    def there(self) -> bool:
        """Whether a frame with cameras was shown."""
        return bool(self._nodes)

    def show(self, *, shown: bool) -> None:
        """Draw them, or not."""
        self._visible = shown
        for name, node in self._nodes.items():
            node.visible = shown and name in self._there

    def _show(self, moment: Moment) -> None:
        cameras = cameras_of(moment)
        self._there = frozenset(one.name for one in cameras)
        with self._server.atomic():
            for one in cameras:
                self._draw(one)
            self.show(shown=self._visible)

    def _draw(self, one: StandingCamera) -> None:
        node = self._nodes.get(one.name)
        if node is None:
            node = self._nodes[one.name] = self._server.scene.add_camera_frustum(
                f"{RIG}/camera {one.name}",
                *one.opening,
                scale=one.length_m,
                color=CAMERA_COLOUR,
                image=one.photo,
            )
        else:
            if (node.fov, node.aspect) != one.opening:  # of another rig
                node.fov, node.aspect = one.opening
            if one.photo is not None:
                node.image = one.photo
        T = one.T_forward_camera
        node.wxyz, node.position = quaternion_wxyz(T[:3, :3]), T[:3, 3]
