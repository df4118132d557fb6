"""The views of a film that are worth a calibration: steady, sharp, and each new."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.capture import (
    NEW_DISTANCE,
    STEADY_PER_1000,
    moved_per_1000,
)
from pseudolidar.calibration.boards.choosing import Judged, ViewChooser, Why
from pseudolidar.calibration.boards.seen import BoardSeen

# More views hardly better a calibration and each costs time.
MOST_VIEWS = 60
# While fewer are found, views count that moved more, px for each 1000 px of the picture's width:
# eyes that are exposed at the same time see a moving board, too, at the same place.
ENOUGH_VIEWS, LIMITS_PER_1000 = 10, (STEADY_PER_1000, 4.0, 16.0)
# Share of neighbours between which a board hardly moved in pictures that are a film. Of a long one
# every second pair of neighbours that are looked at are neighbours in the film; of three real sets
# of single pictures 0 to 11 % are so near.
FILM_SHARE = 0.3


@dataclass(frozen=True)
class Chosen:
    """Which views of a film were taken, and what became of the others.

    Args:
        views: in order.
        frames: of the film.
        unseen: how many do not show the board to both eyes.
        moving: how many show it moving.
        blurred: how many show it blurred.
        steady_per_1000: how far the board may have moved between frames, px for each 1000 px of
            the picture's width.
    """

    views: tuple[BoardSeen, ...]
    frames: int
    unseen: int
    moving: int
    blurred: int
    steady_per_1000: float = STEADY_PER_1000

    @property
    def alike(self) -> int:
        """How many show nothing that others do not."""
        return self.frames - len(self.views) - self.unseen - self.moving - self.blurred

    def __str__(self) -> str:
        moved = ""
        if self.steady_per_1000 > STEADY_PER_1000:
            moved = (
                "; few show the board held still, so that moving ones are among them: hold it "
                "still for a second in every place"
            )
        return (
            f"a film: {len(self.views)} views taken of {self.frames} frames; of the others "
            f"{self.unseen} do not show the board to both eyes, {self.moving} show it moving, "
            f"{self.blurred} blurred, {self.alike} as one of those taken does{moved}"
        )


def chosen_views(film: Sequence[BoardSeen], board: Board, *, most: int = MOST_VIEWS) -> Chosen:
    """Choose views of a film.

    Where more are found than wanted, they are taken evenly over the film.

    Args:
        film: what is seen in every frame, in order of time.
        board: which board.
        most: how many at most.
    """
    taken: dict[int, BoardSeen] = {}
    for limit in LIMITS_PER_1000:
        counts = _take(film, taken, ViewChooser(board, steady_per_1000=limit))
        if len(taken) >= ENOUGH_VIEWS:
            break
    views = [taken[place] for place in sorted(taken)]
    step = max(1.0, len(views) / most)
    return Chosen(
        tuple(views[int(n * step)] for n in range(min(len(views), most))),
        len(film),
        counts["unseen"],
        counts["moving"],
        counts["blurred"],
        limit,
    )


def _take(
    film: Sequence[BoardSeen], taken: dict[int, BoardSeen], chooser: ViewChooser
) -> Counter[Why]:
    """Take the views that are new beside those taken, of each time it is held the stillest frame.

    Args:
        film: all frames.
        taken: by their number; what is new is added.
        chooser: of new views.

    Returns:
        How many frames were judged how, those that were taken before left out.
    """
    for seen in taken.values():
        chooser.keep(seen)
    before = frozenset(taken)
    counts: Counter[Why] = Counter()
    held: Judged | None = None  # the view whose frame `place` is taken, as long as it is held still
    place = -1
    for number, seen in enumerate(film):
        judged = chooser.judge(seen)
        counts[judged.why] += number not in before
        if judged.why == "new":
            held = judged
        elif held is None or judged.why != "alike" or not _same(judged, held):
            held = None
            continue
        elif judged.moved_per_1000 < held.moved_per_1000:
            held = replace(judged, places=held.places)
            del taken[place]
        else:
            continue
        place = number
        taken[place] = seen
    return counts


def _same(judged: Judged, held: Judged) -> bool:
    """Whether a board is still where it was taken."""
    return all(
        place.distance(other) < NEW_DISTANCE
        for place, other in zip(judged.places, held.places, strict=True)
    )


def follow_one_another(pictures: Sequence[BoardSeen]) -> bool:
    """Whether pictures are a film: a board mostly stays near from one to the next.

    Args:
        pictures: what is seen in every pair, in their order.
    """
    moved = [
        moved_per_1000(before.left, now.left, now.sizes_px[0][0])
        for before, now in pairwise(pictures)
        if before.left is not None and now.left is not None
    ]
    near = sum(moved_px <= LIMITS_PER_1000[-1] for moved_px in moved)
    return bool(moved) and near >= FILM_SHARE * len(moved)
