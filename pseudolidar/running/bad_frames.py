"""What happens when frames fail: go on and tell, or stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Literal, TypeVar

from pseudolidar.errors import (
    EnvironmentFault,
    StereoConfig,
    TooManyBadFrames,
    UsageError,
    WorkerFault,
)
from pseudolidar.running.crew.attempt import Done, Skipped

OnError = Literal["skip", "stop"]

# A run stops when more than this share of its frames failed ...
MAX_BAD_SHARE = 0.05
# ... but not for so few, which in a short sequence are a large share ...
MIN_BAD_FRAMES = 5
# ... or when as many failed one after the other: then something has happened to the source.
MAX_BAD_IN_A_ROW = 20
# These are nobody's frame's fault: every further frame would fail in the same way.
NOT_THE_FRAME = (EnvironmentFault, WorkerFault, UsageError, StereoConfig)

Result = TypeVar("Result")


def good_frames(
    outcomes: Iterable[Done[Result] | Skipped],
    *,
    frames: int,
    on_error: OnError,
    skipped: Callable[[Skipped], None],
) -> Iterator[Done[Result]]:
    """The frames that passed; the others are handed to `skipped`, as long as they are few.

    Frames that the source refused when it was opened (index None) are known before the start and
    stop nothing, as long as there are others.

    Args:
        outcomes: of `stream`.
        frames: how many frames the source has.
        on_error: "skip" goes on after a bad frame, "stop" raises its error.
        skipped: told of each bad frame, before anything is raised.

    Raises:
        TooManyBadFrames: more than 5 % (and at least 5 frames), 20 in a row, or all of them.
        PseudolidarError: of the frame itself, with `on_error="stop"`, where it is not the frame's
            fault, or where no frame passed and all failed alike.
    """
    good, bad, in_a_row, kinds = 0, 0, 0, set()
    last: Skipped | None = None
    for outcome in outcomes:
        if isinstance(outcome, Done):
            good, in_a_row = good + 1, 0
            yield outcome
            continue
        skipped(outcome)
        if outcome.index is None and frames:
            continue
        if on_error == "stop" or isinstance(outcome.error, NOT_THE_FRAME):
            raise outcome.error
        last, bad, in_a_row = outcome, bad + 1, in_a_row + 1
        kinds.add(outcome.error.code)
        many = bad >= MIN_BAD_FRAMES and bad > MAX_BAD_SHARE * frames
        if frames and (many or in_a_row >= MAX_BAD_IN_A_ROW):
            break
    else:
        if good or last is None or bad < frames:
            return
    assert last is not None
    raise last.error if not good and len(kinds) == 1 else _too_many(bad, good + bad, last)


def _too_many(bad: int, done: int, last: Skipped) -> TooManyBadFrames:
    return TooManyBadFrames(
        f"{bad} of {done} frames failed, the last one ({last.id}) with: {last.error}",
        want=f"at most {MAX_BAD_SHARE:.0%} bad frames and no {MAX_BAD_IN_A_ROW} in a row",
        fix="See report.json for each of them; leave them out with --exclude.",
    )
