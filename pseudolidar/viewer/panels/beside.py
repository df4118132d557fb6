"""Several clouds in one place: over each other, in turn, or side by side."""

from __future__ import annotations

import threading
from dataclasses import replace

from pseudolidar.viewer.comparing.arrangement import (
    ASIDE,
    IN_TURN,
    OVER,
    Arrangement,
    groups_of,
    modes,
)
from pseudolidar.viewer.comparing.companions import Companions
from pseudolidar.viewer.comparing.turns import Turns
from pseudolidar.viewer.controls import set_value
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.view import View

NEAREST_M, FARTHEST_M = 2.0, 100.0
COMMAND = "Show only one of the compared clouds, the next one"


class BesidePanel:
    """How the sequences are shown, where there are several; else the two chosen clouds.

    Args:
        view: what is looked at.
        companions: sequences beside the first one.
    """

    def __init__(self, view: View, companions: Companions) -> None:
        self._view, self._companions, gui = view, companions, view.gui
        # Whose turn it is comes from a thread of its own; setting controls calls back at once.
        self._lock = threading.RLock()
        self._arrangement, self._chosen = Arrangement(), ("", "")
        self._turns = Turns(self._next_turn)
        self._mode = gui.add_dropdown("Arranged", (OVER, IN_TURN, ASIDE))
        self._apart = gui.add_slider(
            "Apart, m", min=NEAREST_M, max=FARTHEST_M, step=1.0,
            initial_value=self._arrangement.apart_m, visible=False,
        )  # fmt: skip
        self._text = gui.add_markdown("", visible=False)
        self._mode.on_update(lambda _: self._set(mode=self._mode.value))
        self._apart.on_update(lambda _: self._set(apart_m=self._apart.value))
        gui.add_command(COMMAND, hotkey="B").on_trigger(lambda _: self._step())
        view.on_shown(self._show)
        view.on_stop(self._turns.close)

    def choose(self, *names: str) -> None:
        """The two clouds that are compared have changed."""
        self._chosen = (names[0], names[1])
        self._arrange()

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of clouds by what they are shown with."""
        stage, moment = self._view.stage, self._view.moment
        return groups_of(
            tuple(stage.shown),
            self._companions.every,
            self._chosen,
            makings=() if moment is None else tuple(moment.makings),
            stills=tuple(stage.stills),
        )

    def _show(self, _moment: Moment) -> None:
        self._arrange()

    def _set(self, **changes: str | float) -> None:
        with self._lock:
            self._arrangement = replace(self._arrangement, **changes)  # type: ignore[arg-type]
            self._apart.visible = self._arrangement.mode == ASIDE
            self._turns.run(wanted=self._arrangement.mode == IN_TURN)
            self._arrange()

    def _next_turn(self) -> None:
        with self._lock:
            self._arrangement = replace(self._arrangement, turn=self._arrangement.turn + 1)
            self._arrange()

    def _step(self) -> None:
        """By hand: what is shown stays until the key is pressed again."""
        names = [mode for mode in modes(self.groups) if mode not in (OVER, IN_TURN, ASIDE)]
        if names:
            at = names.index(self._mode.value) + 1 if self._mode.value in names else 0
            set_value(self._mode, names[at % len(names)])

    def _arrange(self) -> None:
        with self._lock:
            groups = self.groups
            if modes(groups) != self._mode.options:
                self._mode.options = modes(groups)
            hidden = self._arrangement.hidden(groups)
            self._view.stage.arrange(hidden, self._arrangement.shifts(groups))
            shown = [name for name, group in groups.items() if not hidden.issuperset(group)]
            self._text.visible = bool(hidden)
            if hidden:
                self._text.content = f"Now shown: **{escaped(', '.join(shown))}**"
