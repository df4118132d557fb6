"""Automatic capture: pairs in which both eyes see a board, held still, sharp, in a new way."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.capture import ViewPlace, is_new, is_sharp, is_steady
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.coverage import Coverage
from pseudolidar.calibration.boards.find import find_board
from pseudolidar.geometry.grey import grey8_of
from pseudolidar.sources.capture.eyes import Eyes
from pseudolidar.sources.capture.shots import ShotPair
from pseudolidar.structures.arrays import Image, UInt8, size_of

_log = logging.getLogger(__name__)
NAMES = ("left", "right")


@dataclass(eq=False)
class _EyeViews:
    """What one eye has seen of the board."""

    before: Corners | None = None
    kept: list[Corners] = field(default_factory=list)
    places: list[ViewPlace] = field(default_factory=list)
    size_px: tuple[int, int] = (1, 1)

    @property
    def coverage(self) -> Coverage:
        return Coverage.of(self.kept, self.size_px)


class NewViews:
    """Wants the pairs that are worth keeping, and knows where to hold the board next.

    A view is new if it is for one of the eyes: a board at the edge of one picture is well inside
    the other.

    Args:
        board: what is held up.
        eyes: how left and right are found.
    """

    def __init__(self, board: Board, eyes: Eyes) -> None:
        self._board, self._eyes = board, eyes
        self._views = (_EyeViews(), _EyeViews())
        self._said = "looking for the board"

    def __call__(self, shots: ShotPair) -> bool:
        """Whether to keep a pair."""
        left, right, _ = self._eyes.pair(shots)
        greys, found = self._looked(left, right)
        self._said = self._verdict(greys, found)
        for views, corners in zip(self._views, found, strict=True):
            views.before = corners
        if self._said:
            return False
        self._keep(greys, found)
        self._said = "kept"
        _log.info("%s", self.words)
        return True

    def remember(self, pairs: Iterable[tuple[Image, Image]]) -> None:
        """Count pairs that were kept before, as far as the board is found in both eyes."""
        for left, right in pairs:
            greys, found = self._looked(left, right)
            if all(found):
                self._keep(greys, found)

    @property
    def words(self) -> str:
        """What was said of the last pair, what is covered, and where to hold the board next."""
        left, right = (views.coverage for views in self._views)
        wanted = [
            f"{name}: {coverage.emptiest}"
            for name, coverage in zip(NAMES, (left, right), strict=True)
            if coverage.emptiest
        ]
        hold = f"; hold it where it was not yet: {', '.join(wanted)}" if wanted else ""
        share = f"{left.share:.0%} of the left and {right.share:.0%} of the right picture covered"
        return f"{self._said}; {len(self._views[0].kept)} views, {share}{hold}"

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        covered = {name: views.coverage for name, views in zip(NAMES, self._views, strict=True)}
        return {
            "views": len(self._views[0].kept),
            **{f"coverage_{name}": coverage.share for name, coverage in covered.items()},
            **{f"next_{name}": coverage.emptiest for name, coverage in covered.items()},
        }

    def _looked(
        self, left: Image, right: Image
    ) -> tuple[tuple[UInt8, UInt8], list[Corners | None]]:
        """Both pictures in grey, and the board in each, looked for in the quickest way."""
        greys = grey8_of(left), grey8_of(right)
        return greys, [find_board(grey, self._board, thorough=False) for grey in greys]

    def _verdict(self, greys: tuple[UInt8, UInt8], found: list[Corners | None]) -> str:
        """Why a pair is not worth keeping, "" if it is."""
        news = False
        for name, views, grey, corners in zip(NAMES, self._views, greys, found, strict=True):
            if corners is None:
                return f"the {name} eye does not see the board"
            if views.before is None or not is_steady(views.before, corners, grey.shape[1]):
                return "moving"
            if not is_sharp(grey, corners):
                return f"blurred in the {name} eye"
            news = news or is_new(self._place(corners, grey), views.places)
        return "" if news else "as one of the others"

    def _keep(self, greys: tuple[UInt8, UInt8], found: list[Corners | None]) -> None:
        for views, grey, corners in zip(self._views, greys, found, strict=True):
            if corners is not None:
                views.size_px = size_of(grey)
                views.kept.append(corners)
                views.places.append(self._place(corners, grey))

    def _place(self, corners: Corners, grey: UInt8) -> ViewPlace:
        return ViewPlace.of(corners, self._board.points_m, size_of(grey))
