"""The list of obstacles: a page of our own within viser's, that asks for what it shows."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.objects.scene import ObjectScene
from pseudolidar.viewer.view import View

PAGE = Path(__file__).parent.parent / "pages" / "obstacles.html"
HEIGHT_PX = 260


class ObstacleList:
    """Tells objects, the nearest first; a click on one follows it, or no one any more.

    Args:
        view: what is looked at.
        version: changes with what is told.
        told: what is told.
        clicked: called with the key of the object that somebody clicks on.
    """

    def __init__(
        self,
        view: View,
        version: Callable[[], str],
        told: Callable[[], ObjectScene],
        clicked: Callable[[str], None],
    ) -> None:
        self._view, self._version, self._told, self._clicked = view, version, told, clicked
        page = PAGE.read_bytes()
        view.server.pages |= {
            "/obstacles": lambda _query: Answer(page, "text/html; charset=utf-8"),
            "/obstacles/state": self._state,
            "/obstacles/choose": self._chosen,
        }
        view.gui.add_html(
            f'<iframe src="/obstacles" title="Obstacles" style="width:100%;height:{HEIGHT_PX}px;'
            'border:0;display:block"></iframe>'
        )

    def _chosen(self, query: Mapping[str, str]) -> Answer:
        self._clicked(query.get("key", ""))
        return self._state({})

    def _state(self, _query: Mapping[str, str]) -> Answer:
        scene = self._told()
        state = {
            "version": self._version(),
            "dark": self._view.dark,
            "text": scene.text,
            "corridor": "" if scene.corridor is None else scene.corridor.text,
            "chosen": scene.chosen,
            "rows": [one.row for one in scene.objects],
        }
        return Answer(json.dumps(state).encode())
