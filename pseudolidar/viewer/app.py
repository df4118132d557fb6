"""The viewer as a whole: a server, a sequence, and its panels."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Self

from pseudolidar.running.sighting import Seen
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.address import Address
from pseudolidar.viewer.panels.picture import PicturePanel
from pseudolidar.viewer.panels.scene import ScenePanel
from pseudolidar.viewer.panels.time import TimePanel
from pseudolidar.viewer.reel import Reel
from pseudolidar.viewer.server import GuardedServer, serve
from pseudolidar.viewer.view import View

TITLE = "pseudolidar"
# Where a camera looks from at first: behind the rig, above it, ahead; m.
FROM_M, AT_M = (-8.0, 0.0, 5.0), (12.0, 0.0, 0.0)


class App:
    """A viewer that serves.

    Args:
        server: with its guard.
        reel: what is looked at.
        sighted: a frame to what things in it are measured by; None where they cannot be.
    """

    def __init__(
        self, server: GuardedServer, reel: Reel, sighted: Callable[[Frame], Seen] | None = None
    ) -> None:
        self.view = View(server, reel)
        camera = server.viser.initial_camera
        camera.position, camera.look_at = FROM_M, AT_M
        self.view.set_theme(dark=True)
        self.time = TimePanel(self.view)
        self.picture = PicturePanel(self.view, sighted)
        self.scene = ScenePanel(self.view)
        self._ended = threading.Event()

    @classmethod
    @contextlib.contextmanager
    def served(
        cls, address: Address, reel: Reel, sighted: Callable[[Frame], Seen] | None = None
    ) -> Iterator[Self]:
        """Serve a sequence, and end with the block.

        Raises:
            ServeError: the address cannot be had.
        """
        app = cls(serve(address, label=TITLE), reel, sighted)
        app.view.start()
        try:
            yield app
        finally:
            app.view.stop()

    @property
    def url(self) -> str:
        """Address with its token."""
        return self.view.server.url

    def wait(self) -> None:
        """Until the process is asked to end."""
        while not self._ended.wait(0.2):
            pass
