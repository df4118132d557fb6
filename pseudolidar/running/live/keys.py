"""Keys that a person presses while something runs."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator, Mapping

# How often it is looked whether keys are still wanted.
LOOK_S = 0.2


@contextlib.contextmanager
def keys(actions: Mapping[str, Callable[[], None]]) -> Iterator[bool]:
    """Call an action for each of its keys; yields whether anybody can press one.

    Where standard input is no terminal, or that of another job, it is left alone.

    Args:
        actions: what to do, by character; called from a thread.
    """
    if not _is_ours():
        yield False
        return
    descriptor = sys.stdin.fileno()
    before, stop = termios.tcgetattr(descriptor), threading.Event()
    thread = threading.Thread(
        target=_read, args=(descriptor, actions, stop), name="keys", daemon=True
    )
    tty.setcbreak(descriptor)  # ctrl-C stays a signal
    thread.start()
    try:
        yield True
    finally:
        stop.set()
        thread.join()
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _is_ours() -> bool:
    """Whether standard input is a terminal that this process may read: else it would be stopped."""
    try:
        descriptor = sys.stdin.fileno()
        return os.isatty(descriptor) and os.tcgetpgrp(descriptor) == os.getpgrp()
    except (OSError, ValueError, AttributeError):
        return False


def _read(
    descriptor: int, actions: Mapping[str, Callable[[], None]], stop: threading.Event
) -> None:
    while not stop.is_set():
        ready, _, _ = select.select([descriptor], [], [], LOOK_S)
        if not ready or not _is_ours():
            continue
        pressed = os.read(descriptor, 1)
        if not pressed:
            return
        action = actions.get(pressed.decode("latin-1"))
        if action is not None:
            action()
