"""A bar of a round length in the scene of each browser, as its own view needs it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.viewer.octree.chosen import Eye
from pseudolidar.viewer.scales.ruler import PIECES, Ruler

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle, ViserServer

_log = logging.getLogger(__name__)

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
        self._lookers: dict[int, Looker] = {}
        self._shown = True
        self._awake, self._ended = threading.Event(), threading.Event()
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._gone)
        self._thread: threading.Thread | None = None

    def show(self, *, shown: bool) -> None:
        """Draw it, or not."""
        self._shown = shown
        self.wake()

    def wake(self) -> None:
        """Look again where it is to be: something has changed."""
        self._awake.set()

    def close(self) -> None:
        """Draw nothing more."""
        self._ended.set()
        self._awake.set()
        if self._thread is not None:
            self._thread.join()

    def of(self, client_id: int) -> Ruler | None:
        """The bar that a browser has; None for none."""
        looker = self._lookers.get(client_id)
        return None if looker is None or not self._shown else looker.ruler

    def _connected(self, client: ClientHandle) -> None:
        self._lookers[client.client_id] = Looker(client)

        # In the loop of viser itself, since it only leaves word.
        async def moved(_: CameraHandle) -> None:
            self._awake.set()

        client.camera.on_update(moved)
        if self._thread is None and not self._ended.is_set():
            self._thread = threading.Thread(target=self._run, name="ruler", daemon=True)
            self._thread.start()
        self._awake.set()

    def _gone(self, client: ClientHandle) -> None:
        self._lookers.pop(client.client_id, None)

    def _run(self) -> None:
        while not self._ended.is_set():
            self._awake.wait()
            self._awake.clear()
            for looker in list(self._lookers.values()):
                try:
                    self._draw(looker)
                except Exception:  # one that is gone, or odd, must not keep others from drawing
                    _log.exception("the scale bar cannot be drawn for a browser")
            self._ended.wait(PAUSE_S)

    def _draw(self, looker: Looker) -> None:
        for node in looker.nodes:
            node.visible = self._shown
        eye, look_at = _view_of(looker.client)
        if not self._shown or eye is None:
            return
        ruler = Ruler.before(eye, look_at, self._level_m())
        if ruler == looker.ruler:
            return
        if not looker.nodes:
            looker.nodes = _nodes(looker.client.scene, ruler)
        looker.ruler = ruler
        bar, marks, *words = looker.nodes
        bar.points, marks.points = ruler.pieces, ruler.marks
        for node, (text, place) in zip(words, ruler.ends, strict=True):
            node.text, node.position = text, place


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
