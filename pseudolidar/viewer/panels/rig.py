"""The rig refined on what is looked at, and the frames by both rigs in one scene."""

from __future__ import annotations

import threading
from collections.abc import Callable

from pseudolidar.errors import PseudolidarError
from pseudolidar.viewer.answers import Answer
from pseudolidar.viewer.comparing.companions import Companion, Companions
from pseudolidar.viewer.comparing.joined import join
from pseudolidar.viewer.comparing.rigs import RIG_FILE, Ended, RigShop
from pseudolidar.viewer.latest import Latest
from pseudolidar.viewer.moment import STEREO
from pseudolidar.viewer.panels.time import escaped
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.view import View

REFINED, STOCK = "refined rig", "stock rig"
PLACE = "/compare/rig"
HINT = (
    "Fits the smooth error of the disparities to the scans or the truth of these frames, as "
    "`pseudolidar refine` does, and shows the frames by both rigs. **B** shows one at a time."
)
SAVE = (
    f'<p style="margin:4px 10px;font-size:0.85em"><a href="{PLACE}" download="{RIG_FILE}">Save as '
    f"{RIG_FILE}</a>, for <code>--rig {RIG_FILE}</code> of every command.</p>"
)


class RigPanel:
    """A button to refine the rig, and one to see the stock rig where another was given.

    Args:
        view: what is looked at.
        companions: sequences beside the first one.
        shop: other rigs for the first one.
    """

    def __init__(self, view: View, companions: Companions, shop: RigShop) -> None:
        self._view, self._companions, self._shop = view, companions, shop
        self._first, self._file, self._seen, gui = view.reel, b"", 0, view.gui
        self._work: Latest[str] = Latest(self._do, name="viewer-rig")
        view.server.pages[PLACE] = lambda _query: Answer(self._file, download=RIG_FILE)
        with gui.add_folder("Rig"):
            gui.add_markdown(HINT)
            self._stock = gui.add_button("Show the stock rig too", visible=shop.given)
            self._refine = gui.add_button("Refine on these frames")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._stop = gui.add_button("Stop", visible=False)
            self._text = gui.add_markdown("", visible=False)
            self._save = gui.add_html(SAVE, visible=False)
        self._lock = threading.Lock()
        self._working = self._ended = False
        self._overtaken: Callable[[], bool] = lambda: False
        self._stock.on_click(lambda _: self._ask(STOCK))
        self._refine.on_click(lambda _: self._ask(REFINED))
        self._stop.on_click(lambda _: self._end())
        view.on_stop(self.close)

    def close(self) -> None:
        """Fit nothing more."""
        self._end()
        self._work.close()

    def _end(self) -> None:
        self._ended = True

    def _ask(self, what: str) -> None:
        """Begin at once for those who look, so that neither a second click nor Stop is lost."""
        with self._lock:
            if self._working:
                return
            self._working, self._ended = True, False
        self._seen = 0
        self._move(0.0)
        self._busy(busy=True)
        self._work.ask(what)

    def _do(self, what: str, overtaken: Callable[[], bool]) -> None:
        self._overtaken = overtaken
        try:
            self._go_on()
            if what == STOCK:
                reel = self._shop.by_rig(None)
                self._go_on()
                self._join(STOCK, reel)
            else:
                self._fit()
        except PseudolidarError as error:  # of a fit that is ended it may be another one
            self._say("Stopped." if self._ended or overtaken() else str(error))
        finally:
            self._busy(busy=False)
            self._working = False

    def _fit(self) -> None:
        found = self._shop.refined(self._told)
        self._go_on()
        self._say("\n".join(found.lines))
        if found.reel is not None:
            self._file, self._save.visible = found.file, True
            self._join(REFINED, found.reel)

    def _join(self, label: str, reel: Reel) -> None:
        """The same look as the first one's: what differs is the rig."""
        companion = Companion.of(label, reel, self._first)
        join(self._view, self._companions, companion, self._view.stage.look(STEREO))

    def _go_on(self) -> None:
        if self._ended or self._overtaken():
            raise Ended("stopped by hand", want="a fit that nobody ends")

    def _told(self, frames: int) -> None:
        self._go_on()
        self._seen += 1
        self._move(min(self._seen / frames, 1.0))

    def _move(self, share: float) -> None:
        self._progress.value = 100.0 * share  # type: ignore[misc] # a setter that mypy misses

    def _busy(self, *, busy: bool) -> None:
        self._progress.visible = self._stop.visible = busy
        self._refine.disabled = self._stock.disabled = busy

    def _say(self, words: str) -> None:
        self._text.content = "\n\n".join(escaped(line) for line in words.splitlines())
        self._text.visible = True
