"""Judges pairs of a film or of live cameras one after the other: which are worth keeping."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.capture import (
    STEADY_PER_1000,
    ViewPlace,
    is_new,
    moved_per_1000,
)
from pseudolidar.calibration.boards.corners import Corners
from pseudolidar.calibration.boards.coverage import Coverage
from pseudolidar.calibration.boards.seen import BoardSeen

Why = Literal["unseen", "moving", "blurred", "alike", "new"]
EYES = ("left", "right")


@dataclass(frozen=True)
class Judged:
    """What a pair is worth.

    Args:
        why: it is kept ("new"), or not.
        eye: which eye does not see the board, or sees it blurred; "" where it is not one of them.
        moved_per_1000: how far the board moved since the pair before, px for each 1000 px of the
            picture's width.
        places: where the board stands in each eye, if it is steady and sharp.
    """

    why: Why
    eye: str = ""
    moved_per_1000: float = float("inf")
    places: tuple[ViewPlace, ...] = ()


@dataclass(eq=False)
class EyeViews:
    """What one eye has seen of the board.

    Args:
        before: in the pair before.
        kept: in every pair that was kept.
        places: where the board stood there.
        size_px: (width, height) of its pictures.
    """

    before: Corners | None = None
    kept: list[Corners] = field(default_factory=list)
    places: list[ViewPlace] = field(default_factory=list)
    size_px: tuple[int, int] = (1, 1)

    @property
    def coverage(self) -> Coverage:
        """Where in the picture the board was seen in pairs that were kept."""
        return Coverage.of(self.kept, self.size_px)


class ViewChooser:
    """Keeps the pairs in which both eyes see a board held still, sharp, in a new way.

    A view is new if it is for one of the eyes: a board at the edge of one picture is well inside
    the other. Whether the board is still shows beside the pair before, so that the first pair in
    which both eyes see it is not kept.

    Args:
        board: what is held up.
        steady_per_1000: how far a board that is still moves between pairs, px for each 1000 px of
            the picture's width.
    """

    def __init__(self, board: Board, *, steady_per_1000: float = STEADY_PER_1000) -> None:
        self._points_m, self._steady = board.points_m, steady_per_1000
        self.eyes = EyeViews(), EyeViews()

    def judge(self, seen: BoardSeen) -> Judged:
        """What a pair is worth, the next one in time; a new view is kept."""
        judged = self._judged(seen)
        for views, corners in zip(self.eyes, seen.eyes, strict=True):
            views.before = corners
        if judged.why == "new":
            self.keep(seen)
        return judged

    def keep(self, seen: BoardSeen) -> None:
        """Count a pair as kept, whatever it is worth."""
        places = self._places(seen)
        for views, corners, place, size_px in zip(
            self.eyes, seen.eyes, places, seen.sizes_px, strict=True
        ):
            assert corners is not None
            views.size_px = size_px
            views.kept.append(corners)
            views.places.append(place)

    def _judged(self, seen: BoardSeen) -> Judged:
        for eye, corners in zip(EYES, seen.eyes, strict=True):
            if corners is None:
                return Judged("unseen", eye)
        moved = self._moved(seen)
        if moved > self._steady:
            return Judged("moving", moved_per_1000=moved)
        for eye, sharp in zip(EYES, seen.sharp, strict=True):
            if not sharp:
                return Judged("blurred", eye, moved)
        places = self._places(seen)
        news = [is_new(place, v.places) for place, v in zip(places, self.eyes, strict=True)]
        return Judged("new" if any(news) else "alike", "", moved, places)

    def _moved(self, seen: BoardSeen) -> float:
        """How far the board moved in the eye in which it moved farther."""
        return max(
            float("inf")
            if views.before is None or corners is None
            else moved_per_1000(views.before, corners, size_px[0])
            for views, corners, size_px in zip(self.eyes, seen.eyes, seen.sizes_px, strict=True)
        )

    def _places(self, seen: BoardSeen) -> tuple[ViewPlace, ...]:
        return tuple(
            ViewPlace.of(corners, self._points_m, size_px)
            for corners, size_px in zip(seen.eyes, seen.sizes_px, strict=True)
            if corners is not None
        )
