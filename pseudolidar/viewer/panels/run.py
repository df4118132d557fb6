"""How far a run is, and whether its newest frame is shown."""

from __future__ import annotations

from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.view import View

WAITING = "*The first frame is being made ...*"
NOTHING = "The run has ended: every frame was done before. `pseudolidar view` shows its folder."


class RunPanel:
    """In place of a time line, while a run goes on.

    Args:
        view: what is looked at.
        reel: its frames.
    """

    def __init__(self, view: View, reel: LiveReel) -> None:
        self._view, self._reel = view, reel
        self._shown = Moment("", 0)
        self._made = self._passed_over = 0
        view.gui.add_markdown(escaped(reel.name))
        self._text = view.gui.add_markdown(WAITING)
        self._hold = view.gui.add_checkbox("Stay at this frame", initial_value=False)
        self._hold.on_update(lambda _: self._set_hold())
        view.on_shown(self._show)

    def told(self, made: int, passed_over: int) -> None:
        """How many frames were made, and how many of them gave way to newer ones."""
        self._made, self._passed_over = made, passed_over
        self._say()

    def _set_hold(self) -> None:
        self._reel.hold(held=self._hold.value)
        self._view.remake()

    def _show(self, moment: Moment) -> None:
        self._shown = moment
        self._say()

    def _say(self) -> None:
        reel, moment = self._reel, self._shown
        if not self._made:
            self._text.content = NOTHING if reel.finished else WAITING
            return
        of_all = "" if reel.frames is None else f" of {reel.frames}"
        points = sum(map(len, moment.clouds.values()))
        ended = " &nbsp; **The run has ended.**" if reel.finished else ""
        self._text.content = (
            f"**frame {moment.index + 1}{of_all}** &nbsp; {escaped(moment.id)} &nbsp; "
            f"{points:,} points\n\n"
            f"{self._made} made, {self._passed_over} passed over to keep up{ended}"
        )
