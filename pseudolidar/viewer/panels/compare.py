"""Two clouds of the scene against each other: errors by range of the shown frame, or of all."""

from __future__ import annotations

import html
from collections.abc import Callable

from pseudolidar.errors import printable
from pseudolidar.viewer.comparing.companions import Companions
from pseudolidar.viewer.comparing.pool import EVERY, Pool, choices
from pseudolidar.viewer.comparing.range_plot import told
from pseudolidar.viewer.comparing.rigs import RigShop
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.beside import BesidePanel
from pseudolidar.viewer.panels.rig import RigPanel
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.view import View

NOTHING = ("",)
HINT = (
    "Errors by range, as `pseudolidar compare` tells them: a stereo cloud against its LiDAR scan "
    "or truth by depth, other clouds by the distance to the nearest point."
)
NOT_COMPARED = "These two have nothing to be compared by."
SAME = "Choose two different clouds."
# Faults that are told, of many.
FAULTS_TOLD = 3


class ComparePanel:
    """What is compared with what, and how they differ.

    Args:
        view: what is looked at.
        companions: sequences beside the first one.
        rigs: other rigs for the first one; None where it has none.
    """

    def __init__(self, view: View, companions: Companions, rigs: RigShop | None = None) -> None:
        self._view, self._companions, gui = view, companions, view.gui
        self._frame: Latest[Moment] = Latest(
            self._tell_frame, name="viewer-compare", makes_way=lambda: view.timeline.playing
        )
        self._every: Latest[int] = Latest(self._tell_all, name="viewer-compare-all")
        self._stopped = False
        gui.add_markdown(HINT)
        self._name = gui.add_dropdown("Cloud", NOTHING)
        self._against = gui.add_dropdown("Against", NOTHING)
        self._paired = gui.add_markdown("", visible=False)
        self._beside = BesidePanel(view, companions)
        self._wanted = gui.add_checkbox("Errors of the shown frame", initial_value=False)
        self._told = gui.add_html("", visible=False)
        self._all = gui.add_button("Errors of all frames", visible=len(view.timeline) > 1)
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._stop = gui.add_button("Stop", visible=False)
        self._told_all = gui.add_html("", visible=False)
        self.rig = None if rigs is None else RigPanel(view, companions, rigs)
        for control in (self._name, self._against, self._wanted):
            control.on_update(lambda _: self._ask())
        self._all.on_click(lambda _: self._every.ask(len(view.timeline)))
        self._stop.on_click(lambda _: self._end())
        view.on_shown(self._show)
        view.on_stop(self.close)

    def close(self) -> None:
        """Tell nothing more."""
        self._stopped = True
        self._frame.close()
        self._every.close()

    def _end(self) -> None:
        self._stopped = True

    def _show(self, moment: Moment) -> None:
        names, references = choices(moment, self._view.stage.stills)
        if names and names != self._name.options:
            begins = EVERY in names and EVERY not in self._name.options
            self._name.options = names
            if begins:
                set_value(self._name, EVERY)
        if references and references != self._against.options:
            self._against.options = references
        self._tell_pairs()
        self._ask()

    def _tell_pairs(self) -> None:
        """Which frames belong together: where nothing else tells it, only their place does."""
        lines = [escaped(f"{one.label}: {one.how}") for one in self._companions.every]
        told = "  \n".join(lines)
        if told != self._paired.content:
            self._paired.content, self._paired.visible = told, bool(lines)

    def _ask(self) -> None:
        moment = self._view.moment
        self._beside.choose(self._name.value, self._against.value)
        self._told.visible = self._wanted.value
        if self._wanted.value and moment is not None:
            self._frame.ask(moment)

    def _tell_frame(self, moment: Moment, _overtaken: Callable[[], bool]) -> None:
        pool = Pool(self._name.value, self._against.value)
        self._add(pool, moment)
        self._told.content = self._words(pool)

    def _tell_all(self, frames: int, overtaken: Callable[[], bool]) -> None:
        self._stopped = False
        self._move(0.0)
        self._progress.visible = self._stop.visible = True
        pool = Pool(self._name.value, self._against.value, frames=frames)
        try:
            for index in range(frames):
                if self._stopped or overtaken():
                    break
                self._add(pool, self._view.made(index))
                self._move((index + 1) / frames)
        finally:
            self._progress.visible = self._stop.visible = False
        self._told_all.content, self._told_all.visible = self._words(pool), True

    def _add(self, pool: Pool, moment: Moment) -> None:
        pool.add(moment, self._view.stage.whole_stills, self._view.stage.trees)

    def _move(self, share: float) -> None:
        self._progress.value = 100.0 * share  # type: ignore[misc] # a setter that mypy does not see

    def _words(self, pool: Pool) -> str:
        if pool.name == pool.against:
            return paragraph(SAME)
        found = pool.told()
        faults = [paragraph(said) for said in (*pool.notes, *pool.faults[:FAULTS_TOLD])]
        labels = [one.label for one in self._companions.every]
        return "".join([told(found, labels) if found else paragraph(NOT_COMPARED), *faults])


def paragraph(words: str) -> str:
    """Words of files and users as a paragraph of HTML."""
    return f'<p style="margin:4px 10px;font-size:0.85em">{html.escape(printable(words))}</p>'
