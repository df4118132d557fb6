"""A bar of a round length in the scene of each browser, as its own view needs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.viewer.browsers import Browsers
from pseudolidar.viewer.octree.chosen import Eye
from pseudolidar.viewer.scales.ruler import PIECES, Ruler

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

# A view that moves is looked at no more often, s.
PAUSE_S = 0.1
# Both, and the marks, are seen on dark pages and on light ones.
LIGHT, DARK, MARK = (165, 165, 165), (200, 20, 20), (165, 165, 165)
BAR_PX, MARK_PX = 5.0, 2.0


@dataclass
class Looker:
    """What a browser has.

    Args:
        client: to draw for.
        ruler: that it has.
        nodes: of viser: the bar, its marks, what is written.
    """

    client: ClientHandle
    ruler: Ruler | None = None
    nodes: tuple[Any, ...] = ()


class DrawnRuler:
    """Draws, in a thread of its own.

    Args:
        server: of the browsers.
        level_m: tells the height of the ground in the scene.
    """

    def __init__(self, server: ViserServer, level_m: Callable[[], float]) -> None:
        self._level_m = level_m
        self._shown = True
        self._browsers = Browsers(server, Looker, self._draw, name="ruler", pause_s=PAUSE_S)

    def show(self, *, shown: bool) -> None:
        """Draw it, or not."""
        self._shown = shown
        self.wake()

    def wake(self) -> None:
        """Look again where it is to be: something has changed."""
        self._browsers.wake()

    def close(self) -> None:
        """Draw nothing more."""
        self._browsers.close()

    def of(self, client_id: int) -> Ruler | None:
        """The bar that a browser has; None for none."""
        looker = self._browsers.lookers.get(client_id)
        return None if looker is None or not self._shown else looker.ruler

    def _draw(self, looker: Looker) -> bool:
        for node in looker.nodes:
            node.visible = self._shown
        eye, look_at = _view_of(looker.client)
        if not self._shown or eye is None:
            return False
        ruler = Ruler.before(eye, look_at, self._level_m())
        if ruler == looker.ruler:
            return False
        if not looker.nodes:
            looker.nodes = _nodes(looker.client.scene, ruler)
        looker.ruler = ruler
        bar, marks, *words = looker.nodes
        bar.points, marks.points = ruler.pieces, ruler.marks
        for node, (text, place) in zip(words, ruler.ends, strict=True):
            node.text, node.position = text, place
        return False


def _view_of(client: ClientHandle) -> tuple[Eye | None, Any]:
    """What a browser says of its camera, in the scene."""
    camera = client.camera
    look_at = np.array(camera.look_at, np.float64)
    eye = Eye.of(
        wxyz=np.array(camera.wxyz),
        position_m=np.array(camera.position),
        fov=camera.fov,
        width_px=camera.image_width,
        height_px=camera.image_height,
        T_map_scene=np.eye(4),
    )
    return (eye if np.isfinite(look_at).all() else None), look_at


def _nodes(scene: Any, ruler: Ruler) -> tuple[Any, ...]:
    """Pieces of two colours in turn, as on maps."""
    turns = np.array([LIGHT if number % 2 else DARK for number in range(PIECES)], np.uint8)
    bar = scene.add_line_segments(
        "/ruler/bar", ruler.pieces, np.repeat(turns[:, None], 2, axis=1),
        thickness=BAR_PX, thickness_units="screen",
    )  # fmt: skip
    marks = scene.add_line_segments(
        "/ruler/marks", ruler.marks, MARK, thickness=MARK_PX, thickness_units="screen"
    )
    words = (
        scene.add_label(f"/ruler/{number}", text, position=place, anchor="bottom-center")
        for number, (text, place) in enumerate(ruler.ends)
    )
    return bar, marks, *words
