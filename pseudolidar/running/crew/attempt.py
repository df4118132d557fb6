"""One frame from its source through the per-frame work; whatever goes wrong is a value."""

from __future__ import annotations

import errno
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from pseudolidar.errors import FrameError, MemoryLimit, PseudolidarError
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import Frame

Result = TypeVar("Result", covariant=True)
NewResult = TypeVar("NewResult")
AnyFrame = TypeVar("AnyFrame", bound=Frame)


@dataclass(frozen=True)
class Done(Generic[Result]):
    """A frame that passed.

    Args:
        id: the source's name of the frame.
        index: its position in the source.
        value: what the per-frame work returned.
        cpu_s: processor seconds of its worker, decoding included.
    """

    id: str
    index: int
    value: Result
    cpu_s: float = 0.0


@dataclass(frozen=True)
class Skipped:
    """A frame that did not pass.

    Args:
        id: the source's name of the frame.
        index: its position in the source, None for one that never had a pair.
        error: why.
        trace: traceback of an unexpected failure, for developers; "" otherwise.
    """

    id: str
    index: int | None
    error: PseudolidarError
    trace: str = ""


def attempt(
    source: FrameSequence[AnyFrame], per_frame: Callable[[AnyFrame], NewResult], index: int
) -> Done[NewResult] | Skipped:
    """Load and do one frame; whatever goes wrong is an outcome, not an exception."""
    name, begin_s = source.ids[index], time.thread_time()
    try:
        value = per_frame(source.load(index))
        return Done(name, index, value, time.thread_time() - begin_s)
    except PseudolidarError as error:
        return Skipped(name, index, _detached(error))
    except Exception as error:  # whatever one frame does, the run goes on and tells of it
        if _is_out_of_memory(error):
            return Skipped(name, index, out_of_memory(name, str(error)))
        unexpected = FrameError(
            f"{type(error).__name__}: {error}",
            want="a frame that can be processed",
            fix="Run with --debug and report this.",
            where=f"frame {name}",
        )
        return Skipped(name, index, unexpected, traceback.format_exc())


def out_of_memory(name: str, said: str) -> MemoryLimit:
    """The error of a frame that got no memory, with what the library said about it."""
    return MemoryLimit(
        f"no memory left: {' '.join(said.split())[:200]}",
        want="a frame that fits into memory",
        fix="Use smaller pictures or fewer --workers, or raise --memory-limit.",
        where=f"frame {name}",
    )


def _is_out_of_memory(error: Exception) -> bool:
    if isinstance(error, MemoryError) or (
        isinstance(error, OSError) and error.errno == errno.ENOMEM
    ):
        return True
    import cv2

    return isinstance(error, cv2.error) and error.code == cv2.Error.StsNoMem


def _detached(error: PseudolidarError) -> PseudolidarError:
    """The error without its traceback, which would keep a frame's arrays alive."""
    error.__cause__ = error.__context__ = None
    return error.with_traceback(None)
