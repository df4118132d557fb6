"""Looks for a board in all pairs of a source; of films the views are chosen that are worth it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.boards.film import MOST_VIEWS, chosen_views, follow_one_another
from pseudolidar.calibration.boards.seen import BoardSeen, FindInPair
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.progress import FrameProgress
from pseudolidar.running.stream import stream
from pseudolidar.sources.bare_pairs import BarePair, BarePairs
from pseudolidar.sources.source import evenly_placed

# Pairs that are looked at thoroughly before a set without a board is given up.
PAIRS_TRIED = 2
# Frames of a film that are looked at. Nobody takes so many single pictures of a board.
MOST_FRAMES = 800
_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Looked:
    """What was seen of a board.

    Args:
        found: in every pair that was looked at; of a film in the views that were taken.
        skipped: pairs that cannot be read.
        notes: how views were taken of a film.
    """

    found: tuple[BoardSeen, ...]
    skipped: tuple[Skipped, ...]
    notes: tuple[str, ...] = ()


def boards_in(pairs: BarePairs, board: Board, crew: CrewPlan) -> Looked:
    """What is seen of the board in the pairs of a source.

    First the quick way. Of a film some views are then taken; many pictures are a film too, and a
    video of single pictures is none: most neighbours of a film show the same view. Pictures without
    a board are looked at thoroughly.

    Raises:
        PseudolidarError: no pair can be read; why the first one cannot.
    """
    quick = FindInPair(board, thorough=False)
    looked = _looked_at(_of_long_film(pairs), quick, crew, what="pairs")
    if looked.skipped:
        first = looked.skipped[0].error
        if not looked.found:
            raise first
        _log.warning("%d pairs cannot be read, the first: %s", len(looked.skipped), first)
    frames, count = looked.found, len(looked.found) + len(looked.skipped)
    notes = (f"{count} of {len(pairs.ids)} pairs looked at",) if count < len(pairs.ids) else ()
    if (pairs.film or len(frames) > MOST_VIEWS) and follow_one_another(frames):
        chosen = chosen_views(frames, board)
        return replace(looked, found=chosen.views, notes=(*notes, str(chosen)))
    return replace(looked, found=_closer(pairs, frames, board, crew), notes=notes)


def _of_long_film(pairs: BarePairs) -> BarePairs:
    """Of a long film some frames, evenly, and those next to them: beside them shows what moves."""
    if len(pairs.ids) <= MOST_FRAMES:
        return pairs
    step = 2 * len(pairs.ids) / MOST_FRAMES
    begins = [int(n * step) for n in range(MOST_FRAMES // 2)]
    return pairs.at(sorted({place + after for place in begins for after in range(2)}))


def _closer(
    pairs: BarePairs, found: tuple[BoardSeen, ...], board: Board, crew: CrewPlan
) -> tuple[BoardSeen, ...]:
    """Pairs without a board looked at thoroughly.

    Unless a few of them show that it is another board that is asked for.
    """
    missing = [seen for seen in found if not all(seen.eyes)]
    find = FindInPair(board)
    if missing and len(missing) == len(found):
        few = [missing[place] for place in evenly_placed(len(missing), most=PAIRS_TRIED)]
        tried = _looked_at(_named(pairs, few), find, crew, what="looking closer")
        if not any(any(seen.eyes) for seen in tried.found):
            return found
    closer = _looked_at(_named(pairs, missing), find, crew, what="looking closer")
    better = {seen.id: seen for seen in closer.found}
    return tuple(better.get(seen.id, seen) for seen in found)


def _looked_at(pairs: BarePairs, find: FindInPair, crew: CrewPlan, *, what: str) -> Looked:
    """What is seen in pairs, and those that cannot be read."""

    def look(pair: BarePair) -> BoardSeen:
        return find(pair.left, pair.right, pair.id)

    found: list[BoardSeen] = []
    skipped: list[Skipped] = []
    if not pairs.ids:
        return Looked((), ())
    with FrameProgress(len(pairs.ids), what=what) as progress:
        # The engine asks of a frame only that it can be loaded; these have no calibration yet.
        for outcome in stream(cast("Any", pairs), cast("Any", look), crew=crew):
            if isinstance(outcome, Skipped):
                skipped.append(outcome)
                progress.skip()
            else:
                found.append(outcome.value)
                progress.advance()
    return Looked(tuple(found), tuple(skipped))


def _named(pairs: BarePairs, seen: Sequence[BoardSeen]) -> BarePairs:
    """The pairs that these are."""
    place = {name: index for index, name in enumerate(pairs.ids)}
    return replace(pairs.at([place[each.id] for each in seen]), refused=())
