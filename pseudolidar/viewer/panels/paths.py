"""Paths by name: which colour is which, and whether they are drawn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from pseudolidar.viewer.drawn_path import COMING_COLOUR, DrawnPath
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.shown import Colour, hexadecimal
from pseudolidar.viewer.stills import PATH_COLOUR, StillPath
from pseudolidar.viewer.view import View

WAY = "Way of the rig"


class PathsPanel:
    """A switch for each path: that of the rig as soon as there is one, and those of files.

    Args:
        view: what is looked at.
        way: of the rig; None where nothing moves.
    """

    def __init__(self, view: View, way: DrawnPath | None) -> None:
        self._view, self._way = view, way
        self._known: set[str] = set()
        self._folder = view.gui.add_folder("Paths", visible=False)
        self._show(None)
        view.on_shown(self._show)

    def _show(self, _moment: Moment | None) -> None:
        way = self._way
        if way is not None and way.there:
            legend = f"{swatch(PATH_COLOUR)} driven {swatch(COMING_COLOUR)} to come"
            self._add(WAY, legend, way.show)
        for still in self._view.stage.every_still:
            line = self._view.stage.paths.get(still.name)
            if isinstance(still, StillPath) and line is not None:
                legend = f"{swatch(still.colour)} {still.length_m:.1f} m"
                self._add(still.name, legend, partial(setattr, line, "visible"))

    def _add(self, name: str, legend: str, draw: Callable[[bool], None]) -> None:
        if name in self._known:
            return
        self._known.add(name)
        self._folder.visible = True
        with self._folder:
            shown = self._view.gui.add_checkbox(name, initial_value=True)
            self._view.gui.add_html(
                f'<div style="font-size:0.8em;margin:0 12px 6px">{legend}</div>'
            )
        shown.on_update(lambda _: draw(shown.value))


def swatch(colour: Colour) -> str:
    """A stroke of a colour, for a page."""
    return (
        f'<span style="display:inline-block;width:16px;height:4px;margin:0 3px 3px 6px;'
        f'background:{hexadecimal(colour)}"></span>'
    )
