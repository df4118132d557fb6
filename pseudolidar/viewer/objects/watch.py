"""Objects of the shown frame, found in the background while somebody looks."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace

from pseudolidar.running.sighting import Seen
from pseudolidar.structures.recorded import Frame
from pseudolidar.viewer.moment import Moment
from pseudolidar.viewer.objects.finder import Finder
from pseudolidar.viewer.objects.objects import Find
from pseudolidar.viewer.objects.scene import ObjectScene
from pseudolidar.viewer.objects.shown import Band
from pseudolidar.viewer.objects.teller import RunObjects, ScenesAtOnce, Teller, Wish, pictured


class ObjectWatch:
    """Knows the objects of frames, as far as they are found; callable from any thread.

    Args:
        sighted: a frame to what is seen in it; None where nothing can be measured.
        run: what a run found, by frame.
        came: told the index of each frame that objects are found in.
    """

    def __init__(
        self,
        sighted: Callable[[Frame], Seen] | None,
        run: RunObjects,
        came: Callable[[int], None],
    ) -> None:
        self._sighted = sighted
        self._finder = Finder(came)
        self._lock = threading.Lock()
        wish = Wish()
        self._teller = Teller(wish, run, sighted is not None, wish.in_order())
        self.band = Band()
        self.chosen = ""

    def ask(self, wish: Wish) -> None:
        """Want something else from now on; of other detectors and trackers nothing is chosen."""
        with self._lock:
            before = self._teller.wish
            self._teller = replace(self._teller, wish=wish)
            if wish.of_things != before.of_things:
                self._teller = replace(self._teller, in_order=wish.in_order())
                self.chosen = ""
            if (wish.detect, wish.corridor) != (before.detect, before.corridor):
                self._finder.change(self._find())

    def again(self) -> None:
        """Want the same anew: frames are seen otherwise now."""
        with self._lock:
            self._finder.change(self._find())

    def _find(self) -> Find | None:
        """How to find what is wanted; None for nothing.

        Called with the lock held, so that the last wish is it; the finder holds no lock of its own
        while it calls others.
        """
        wish = self._teller.wish
        if not wish.searching or self._sighted is None:
            return None
        return Find(self._sighted, wish.detect, wish.corridor)

    def want(self, moments: Sequence[Moment]) -> None:
        """Find in these, the first one first."""
        if self._teller.wish.searching:
            frames = ((moment.index, pictured(moment)) for moment in moments)
            self._finder.want([(index, frame) for index, frame in frames if frame is not None])

    def ready(self, moment: Moment) -> bool:
        """Whether all that is wanted of a frame is found."""
        searching = self._teller.wish.searching and self._sighted is not None
        if not searching or pictured(moment) is None:
            return True
        if self._finder.get(moment.index) is not None:
            return True
        self.want([moment])
        return False

    def scene(self, moment: Moment) -> ObjectScene:
        """What is drawn of a frame: of what is not found yet, nothing."""
        found = self._finder.get(moment.index) if self._teller.wish.searching else None
        with self._lock:
            return self._teller.scene(moment, found, self.band, self.chosen)

    def at_once(self) -> ScenesAtOnce:
        """The same for frames that are drawn elsewhere, from the first one on."""
        with self._lock:
            teller = replace(self._teller, in_order=self._teller.wish.in_order())
            return ScenesAtOnce(teller, self._find(), self.band)

    def close(self) -> None:
        """Find nothing more."""
        self._finder.close()
