"""How far a run is, and whether its newest frame is shown."""

from __future__ import annotations

from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.view import View

WAITING = "*The first frame is being made ...*"
NOTHING = "The run has ended: no new frame was made. `pseudolidar view` shows its folder."


class RunPanel:
    """In place of a time line, while a run goes on.

    Args:
        view: what is looked at.
        reel: its frames.
    """

    def __init__(self, view: View, reel: LiveReel) -> None:
        self._view, self._reel = view, reel
        view.gui.add_markdown(escaped(reel.name))
        self._text = view.gui.add_markdown(WAITING)
        self._hold = view.gui.add_checkbox("Stay at this frame", initial_value=False)
        self._hold.on_update(lambda _: self._set_hold())
        view.on_shown(lambda _: self.say())

    def _set_hold(self) -> None:
        self._reel.hold(held=self._hold.value)
        self._view.remake()

    def say(self) -> None:
        """Say how far the run is now."""
        reel, moment = self._reel, self._view.moment
        if not reel.made or moment is None:
            self._text.content = NOTHING if reel.finished else WAITING
            return
        of_all = "" if reel.frames is None else f" of {reel.frames}"
        points = sum(map(len, moment.clouds.values()))
        ended = " &nbsp; **The run has ended.**" if reel.finished else ""
        self._text.content = (
            f"**frame {moment.index + 1}{of_all}** &nbsp; {escaped(moment.id)} &nbsp; "
            f"{points:,} points\n\n"
            f"{reel.made} made, {reel.passed_over} passed over to keep up{ended}"
        )
