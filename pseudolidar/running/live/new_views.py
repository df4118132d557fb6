"""Automatic capture: pairs in which both eyes see a board, held still, sharp, in a new way."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.choosing import EYES, Judged, ViewChooser
from pseudolidar.calibration.boards.eye_order import EyeVotes, eye_order
from pseudolidar.calibration.boards.seen import BoardSeen, FindInPair
from pseudolidar.sources.capture.eyes import Eyes
from pseudolidar.sources.capture.shots import ShotPair
from pseudolidar.structures.arrays import Image

_log = logging.getLogger(__name__)
EXCHANGED = (
    "the cameras are exchanged: what is called the left one stands on the right. Stop, and name "
    "the other camera first, or pass --swap; `calibrate` puts what is saved already right by itself"
)


class NewViews:
    """Wants the pairs that are worth keeping, and knows where to hold the board next.

    Args:
        board: what is held up.
        eyes: how left and right are found.
    """

    def __init__(self, board: Board, eyes: Eyes) -> None:
        self._find, self._eyes = FindInPair(board, thorough=False), eyes
        self._chooser = ViewChooser(board)
        self._said = "looking for the board"
        self._board, self._votes = board, EyeVotes()

    def __call__(self, shots: ShotPair) -> bool:
        """Whether to keep a pair."""
        left, right, _ = self._eyes.pair(shots)
        seen = self._find(left, right, "")
        judged = self._chooser.judge(seen)
        self._said = _said_of(judged)
        if judged.why != "new":
            return False
        self._vote(seen)
        _log.info("%s", self.words)
        return True

    def remember(self, pairs: Iterable[tuple[Image, Image]]) -> None:
        """Count pairs that were kept before, as far as the board is found in both eyes."""
        for left, right in pairs:
            seen = self._find(left, right, "")
            if all(seen.eyes):
                self._chooser.keep(seen)
                self._vote(seen)

    def _vote(self, seen: BoardSeen) -> None:
        """Let a view that is kept say which camera stands on the left, and warn once."""
        before = self._votes.order
        self._votes.add(eye_order(seen, self._board))
        if self._votes.order == "exchanged" != before:
            _log.warning("%s", EXCHANGED)

    @property
    def words(self) -> str:
        """What was said of the last pair, what is covered, and where to hold the board next."""
        left, right = (views.coverage for views in self._chooser.eyes)
        wanted = [
            f"{name}: {coverage.emptiest}"
            for name, coverage in zip(EYES, (left, right), strict=True)
            if coverage.emptiest
        ]
        hold = f"; hold it where it was not yet: {', '.join(wanted)}" if wanted else ""
        share = f"{left.share:.0%} of the left and {right.share:.0%} of the right picture covered"
        exchanged = "exchanged eyes: name the other camera first, or pass --swap; " * (
            self._votes.order == "exchanged"
        )
        return f"{exchanged}{self._said}; {len(self._chooser.eyes[0].kept)} views, {share}{hold}"

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        eyes = self._chooser.eyes
        covered = {name: views.coverage for name, views in zip(EYES, eyes, strict=True)}
        return {
            "views": len(eyes[0].kept),
            "eyes": self._votes.order,
            **{f"coverage_{name}": coverage.share for name, coverage in covered.items()},
            **{f"next_{name}": coverage.emptiest for name, coverage in covered.items()},
        }


def _said_of(judged: Judged) -> str:
    """What is said of a pair."""
    match judged.why:
        case "unseen":
            return f"the {judged.eye} eye does not see the board"
        case "moving":
            return "moving"
        case "blurred":
            return f"blurred in the {judged.eye} eye"
        case "alike":
            return "as one of the others"
        case "new":
            return "kept"
