"""Whether cameras are exchanged, looked for until pairs tell: the first one may show nothing."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

from pseudolidar.calibration.boards.eye_order import EyeOrder, EyeVotes
from pseudolidar.calibration.check import check_pair
from pseudolidar.calibration.check_eyes import EYES
from pseudolidar.errors import PseudolidarError
from pseudolidar.running.live.newest import Newest
from pseudolidar.running.products.product import Product
from pseudolidar.structures.frame import StereoFrame

_log = logging.getLogger(__name__)
# Looking at a pair takes 0.2 s: pauses double from the first to the last, s.
FIRST_S, LAST_S = 1.0, 32.0


class EyeWatch:
    """Looks at pairs with longer and longer pauses, until two more say the one than the other.

    Args:
        swap: the pictures are exchanged already.
    """

    def __init__(self, *, swap: bool) -> None:
        self._swap, self._votes, self._pause_s = swap, EyeVotes(), FIRST_S

    @property
    def order(self) -> EyeOrder:
        """What pairs have said."""
        return self._votes.order

    def __call__(self, pair: StereoFrame) -> float | None:
        """Look at a pair; the seconds until the next look, None once it is told."""
        seen = order_seen(pair)
        self._votes.add(seen)
        if self.order == "exchanged":
            mend = "leave --swap out" if self._swap else "pass --swap"
            _log.warning(
                "check: the cameras are exchanged, hardly a point is right: stop, %s", mend
            )
        if self.order != "unknown":
            return None
        pause_s = self._pause_s
        self._pause_s = FIRST_S if seen != "unknown" else min(2 * pause_s, LAST_S)
        return pause_s


@dataclass(frozen=True)
class Watched:
    """Works on a pair that is looked at, too: of exchanged eyes few become clouds.

    Args:
        work: what is done to a pair.
        watch: looks at it.
    """

    work: Callable[[StereoFrame], Product]
    watch: Newest[StereoFrame]

    def __call__(self, pair: StereoFrame) -> Product:
        """What becomes of the pair."""
        self.watch.show(pair.index, pair)
        return self.work(pair)


def order_seen(pair: StereoFrame) -> EyeOrder:
    """Which camera is the left one, by the side on which near things move."""
    try:
        found = check_pair(pair).findings
    except PseudolidarError:
        return "unknown"  # it is refused in its turn
    (eyes,) = (finding for finding in found if finding.name == EYES)
    if eyes.severity == "stop":
        return "exchanged"
    return "right" if eyes.severity == "good" else "unknown"
