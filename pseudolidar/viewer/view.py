"""What all panels share: the server, the frame that is shown, and the loop that moves it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pseudolidar.viewer.drawn_marks import DrawnMarks
from pseudolidar.viewer.judged import judged
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.ready import AHEAD, Ready
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.server import GuardedServer
from pseudolidar.viewer.stage import Stage
from pseudolidar.viewer.stills import Still
from pseudolidar.viewer.timeline import Timeline

if TYPE_CHECKING:
    from viser import GuiApi

_log = logging.getLogger(__name__)

# How often it is looked whether something is to be drawn, s.
TICK_S = 1 / 60
# What errors are added to frames for.
JUDGING = "errors"


@dataclass
class Trial:
    """A frame that is being made by other settings, by somebody who hands it in himself.

    Args:
        index: of the frame.
        moment: what there is of it so far.
    """

    index: int
    moment: Moment | None = None


class View:
    """A sequence on a server.

    Panels read `moment`, change `timeline`, `stage`, `marks` and `reel`, and call `redraw`. What
    they hand to `on_shown` is called with every frame that was drawn, by the one thread that draws;
    while it plays, what they hand to `wait_for` says whether the following frame may be shown.

    Args:
        server: with its guard.
        reel: what is looked at.
        workers: threads that make frames ready.
    """

    def __init__(self, server: GuardedServer, reel: Reel, *, workers: int = 2) -> None:
        self.server, self.reel = server, reel
        self.stage = Stage(server.viser)
        self.marks = DrawnMarks(server.viser)
        self.timeline = Timeline(reel.times_s)
        self.ready = Ready(self.made, workers=workers)
        # What is added to every frame as it is made, by what it is for.
        self.finishing: dict[str, Callable[[Moment], Moment]] = {}
        self.moment: Moment | None = None
        self.version = 0
        self.draw_s = 0.0  # processor time that the last frame took to draw
        self.dark = True
        self._listeners: list[Callable[[Moment], None]] = []
        self._enders: list[Callable[[], None]] = []
        self._awaited: list[Callable[[Moment], bool]] = []
        self._lock = threading.RLock()
        self._stale = True
        self._laid: list[Still] = []
        self._trial: Trial | None = None
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def gui(self) -> GuiApi:
        """Controls of the page."""
        return self.server.viser.gui

    def set_theme(self, *, dark: bool) -> None:
        """Dark or light."""
        self.dark = dark
        self.version += 1
        self.gui.configure_theme(
            dark_mode=dark, show_share_button=False, show_logo=False, control_width="large"
        )

    def on_shown(self, listener: Callable[[Moment], None]) -> None:
        """Call this with every frame that was drawn."""
        self._listeners.append(listener)

    def on_stop(self, listener: Callable[[], None]) -> None:
        """Call this before the end: what works in the background ends."""
        self._enders.append(listener)

    def wait_for(self, ready: Callable[[Moment], bool]) -> None:
        """While it plays, show no frame before this says that it is ready; asked often."""
        self._awaited.append(ready)

    def redraw(self) -> None:
        """Draw the shown frame again: how it looks has changed."""
        with self._lock:
            self._stale = True

    def lay(self, still: Still) -> None:
        """Draw what does not change, before the next frame; from any thread."""
        with self._lock:
            self._laid.append(still)
            self._stale = True

    def remake(self) -> None:
        """Make all frames again: how they are made has changed."""
        self.ready.forget()
        self.redraw()

    def made(self, index: int) -> Moment:
        """A frame with all that is added to it; callable from any thread."""
        return self.finished(self.reel.load(index))

    def finished(self, moment: Moment) -> Moment:
        """A frame with all that is added to every one."""
        for finish in tuple(self.finishing.values()):
            moment = finish(moment)
        return moment

    def judge(self, *, wanted: bool) -> None:
        """Tell the errors of clouds that have a reference, in frames from now on; or not."""
        if wanted == (JUDGING in self.finishing):
            return
        if wanted:
            self.finishing[JUDGING] = judged
            self.remake()
        else:  # frames that know more than is asked for do no harm
            del self.finishing[JUDGING]

    def try_out(self, reel: Reel) -> Trial:
        """Make frames by another reel from now on, but for the shown one: `present` brings that.

        Until it has been brought, or `end` says that it will not be, no other is made ready.
        """
        with self._lock:
            self.reel, self._trial = reel, Trial(self.timeline.index)
            self.ready.forget()
            return self._trial

    def present(self, trial: Trial, moment: Moment, *, last: bool) -> None:
        """Show what a trial has come to; of one that was followed by another nothing.

        Args:
            trial: that `try_out` gave.
            moment: its frame.
            last: whether it stays, as if it had been made ready as others are.
        """
        moment = self.finished(moment)
        with self._lock:
            if trial is not self._trial:
                return
            trial.moment = moment
            if last:
                self.ready.put(trial.index, moment)
                self._trial = None
            self._stale = True

    def end(self, trial: Trial) -> None:
        """A trial that brings nothing more: its frame is made ready as all others are."""
        with self._lock:
            if trial is self._trial:
                self._trial = None

    def play(self, *, playing: bool) -> None:
        """Play or pause."""
        with self._lock:
            if playing:
                self.timeline.play(time.monotonic())
            else:
                self.timeline.pause()

    def jump(self, index: int) -> None:
        """Show another frame."""
        with self._lock:
            self.timeline.jump(index, time.monotonic())

    def step(self, by: int) -> None:
        """Pause, and show a neighbour."""
        with self._lock:
            self.timeline.step(by, time.monotonic())

    def set_speed(self, speed: float) -> None:
        """Play faster or slower."""
        with self._lock:
            self.timeline.set_speed(speed, time.monotonic())

    def start(self) -> None:
        """Begin to draw, in a thread of its own."""
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Draw nothing more."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        for ender in self._enders:
            ender()
        self.ready.close()
        self.server.stop()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self.tick(time.monotonic())
            except Exception:  # a frame that cannot be drawn must not end the others
                _log.exception("frame %d cannot be drawn", self.timeline.index)
                self._stale = False
            self._ended.wait(TICK_S)

    def tick(self, now_s: float) -> None:
        """Draw the frame that it is time for, if it is ready and not drawn."""
        with self._lock:
            laid, self._laid = self._laid, []
        for still in laid:
            self.stage.put(still)
        with self._lock:
            timeline = self.timeline
            if timeline.due(now_s) and self._may_follow(timeline.following):
                timeline.advance(now_s)
            trial = self._trial
            if trial is not None and trial.index == timeline.index:
                moment = trial.moment
            else:
                self.ready.want(timeline.ahead(AHEAD))
                moment = self.ready.get(timeline.index)
            if moment is None or (moment is self.moment and not self._stale):
                return
            self._stale = False
        self.show(moment)

    def settled(self, index: int) -> Moment:
        """A frame for which all is ready that panels wait for; for who shows every one."""
        moment = self.made(index)
        while not all(ready(moment) for ready in self._awaited):
            time.sleep(TICK_S)
        return moment

    def show(self, moment: Moment) -> None:
        """Draw a frame now; called by one thread alone."""
        begun_s = time.thread_time()
        self.moment = moment
        self.marks.begin(moment.sight)
        self.stage.show(moment)
        self.version += 1
        for listener in self._listeners:
            listener(moment)
        self.draw_s = time.thread_time() - begun_s

    def _may_follow(self, index: int) -> bool:
        moment = self.ready.get(index)
        return moment is not None and all(ready(moment) for ready in self._awaited)
