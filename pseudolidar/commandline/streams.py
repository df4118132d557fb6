"""Who writes where: results on the standard output, everything else on the standard error."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
from collections.abc import Iterator
from typing import TextIO


class _StderrLines(logging.Handler):
    """Writes each message as a line to what `sys.stderr` is at that moment (progress bars too)."""

    def emit(self, record: logging.LogRecord) -> None:
        sys.stderr.write(self.format(record) + "\n")
        sys.stderr.flush()


@contextlib.contextmanager
def lines_of_the_library() -> Iterator[None]:
    """Show what the library has to say (its logger `pseudolidar`, from INFO) meanwhile."""
    logger, handler = logging.getLogger("pseudolidar"), _StderrLines()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


@contextlib.contextmanager
def output_kept_clean() -> Iterator[TextIO]:
    """Yield the real standard output while everything else, native code too, goes to stderr."""
    real = sys.stdout
    try:
        out, err = sys.stdout.fileno(), sys.stderr.fileno()
    except (io.UnsupportedOperation, ValueError):  # replaced by objects without a descriptor
        with contextlib.redirect_stdout(sys.stderr):
            yield real
        return
    real.flush()
    kept = os.dup(out)
    try:
        os.dup2(err, out)
        with os.fdopen(kept, "w", encoding="utf-8", closefd=False) as clean:
            yield clean
    finally:
        real.flush()
        os.dup2(kept, out)
        os.close(kept)


def escape_what_the_terminal_cannot_show() -> None:
    """Print undecodable bytes of file names escaped instead of failing on them."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def write_result(out: TextIO, text: str) -> None:
    """Write the result; a reader that has gone away (`| head`) is no error."""
    try:
        out.write(text.rstrip("\n") + "\n")
        out.flush()
    except BrokenPipeError:
        forget_reader(out)


def forget_reader(out: TextIO) -> None:
    """Send what is still buffered nowhere, so that it raises no second error at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())
