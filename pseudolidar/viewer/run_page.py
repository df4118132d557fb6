"""`--view` of a run: a page on what it makes, while it makes it.

Workers hand over what they have made and go on at once: a thread of the page takes the newest, and
what came between is passed over, and counted. Making ready and drawing get a small share of one
core, whatever a run hands over; a browser that reads nothing holds up nobody.
"""

from __future__ import annotations

import contextlib
import logging
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

from pseudolidar.errors import PseudolidarError
from pseudolidar.running.lingering import after_results
from pseudolidar.running.live.newest import Newest
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.live_reel import LiveReel
from pseudolidar.viewer.meshes import read_still_mesh
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.stills import StillCloud

if TYPE_CHECKING:
    from pseudolidar.viewer.app import App

_log = logging.getLogger(__name__)
Shown = TypeVar("Shown")

# Of one core, what a page may take from its run; and the shortest pause between two frames, s. A
# KITTI frame of 1242x375 takes 20 ms of a core to make ready and draw: four a second take 8 %.
SHARE, PAUSE_S = 0.08, 0.25
# How often it is looked whether there is something new, and pause while nobody looks, s.
IDLE_S, NOBODY_S = 0.1, 2.0


class ViewSettings(Protocol):
    """What the settings of a run say about its page."""

    @property
    def view(self) -> bool:
        """Whether there is one."""

    @property
    def host(self) -> str:
        """To listen at."""

    @property
    def port(self) -> int:
        """To listen at."""


class RunPage(Newest[Shown]):
    """Shows the newest of what a run makes.

    Args:
        app: serves.
        reel: what it shows.
        moment: what is handed over, to what there is to see of it; called in the page's thread.
    """

    def __init__(self, app: App, reel: LiveReel, moment: Callable[[Shown], Moment]) -> None:
        super().__init__("run page", self._take, idle_s=IDLE_S)
        self._app, self._reel, self._moment = app, reel, moment

    def lay(self, name: str, cloud: PointCloud | None) -> None:
        """Draw what the run has made of all frames, such as a map; nothing of nothing."""
        if cloud is not None:
            self._app.view.lay(StillCloud(name, cloud))

    def lay_mesh(self, path: Path | None) -> None:
        """Draw the mesh that the run has written to a file; nothing where it made none.

        A mesh that cannot be read or is too large to be drawn is warned of, and the run goes on.
        """
        if path is None:
            return
        try:
            self._app.view.lay(read_still_mesh(path.stem, path))
        except PseudolidarError as error:  # such as one of more triangles than are drawn
            _log.warning("%s is not shown: %s", path, error)

    def finish(self) -> None:
        """Say that the run has ended."""
        self._reel.finished = True
        self._tell()

    def _take(self, what: Shown) -> float:
        begun_s = time.thread_time()
        view = self._app.view
        try:
            moment = self._moment(what)
        except Exception:  # a run is worth more than its page
            _log.exception("a frame cannot be shown")
            return NOBODY_S
        if self._reel.take(moment):
            view.remake()
        self._tell()
        if not view.server.viser.get_clients():
            return NOBODY_S
        used_s = time.thread_time() - begun_s + view.draw_s
        return max(PAUSE_S, used_s / SHARE)

    def _tell(self) -> None:
        self._reel.made, self._reel.passed_over = self.given, self.passed_over
        if self._app.run is not None:
            self._app.run.say()


@contextlib.contextmanager
def run_page(
    job: ViewSettings,
    source: FrameSequence[Frame],
    moment: Callable[[Shown], Moment],
    *,
    endless: bool = False,
    finds: bool = False,
) -> Iterator[RunPage[Shown] | None]:
    """A page while the block lasts, where one is asked for.

    At a terminal it stays open when the block has ended without an error, until Ctrl-C after the
    results were told; elsewhere, and of runs without an end, it ends with the block.

    Args:
        job: says where, and whether at all.
        source: what the run goes through.
        moment: what is handed over, to what there is to see of it.
        endless: cameras, which are ended by Ctrl-C.
        finds: whether moments come with the objects in them.

    Raises:
        ServeError: the address cannot be had.
    """
    if not job.view:
        yield None
        return
    from pseudolidar.viewer.app import App
    from pseudolidar.viewer.opening import Opened

    reel = LiveReel(source.summary.line, None if endless else len(source.ids), finds=finds)
    with contextlib.ExitStack() as held:
        app = held.enter_context(App.served(Address(job.host, job.port), Opened((reel,))))
        _log.info("%s", app.url)
        with RunPage(app, reel, moment) as page:
            yield page
        page.finish()
        if not endless and sys.stdin.isatty() and sys.stderr.isatty():
            serving = held.pop_all()
            after_results(lambda: _stay(app, serving))


def _stay(app: App, serving: contextlib.ExitStack) -> None:
    with serving:
        _log.info("the page stays open until Ctrl-C: %s", app.url)
        app.wait()
