"""What goes on after a run has told its results, until somebody ends it: pages that stay open."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from pseudolidar.running.signals import SIGNAL_EXIT_BASE

_waits: list[Callable[[], None]] = []


def after_results(wait: Callable[[], None]) -> None:
    """Have this called once the results are told.

    Args:
        wait: returns, or is cut by Ctrl-C, when somebody wants the end.
    """
    _waits.append(wait)


def linger(exit_code: int) -> None:
    """Wait for all that goes on; for nothing where a signal has ended the run already.

    Args:
        exit_code: of the run.
    """
    waits = [*_waits]
    _waits.clear()
    if exit_code > SIGNAL_EXIT_BASE:
        return
    with contextlib.suppress(KeyboardInterrupt):  # the ordinary way out
        for wait in waits:
            wait()
