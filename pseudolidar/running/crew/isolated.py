"""Frames done in processes of their own: one may crash, run out of memory or hang, the run lives.

A process is started for each worker, serves it frame after frame, and is started anew after it
died. It dies with the thread that started it, and so with the run, however that ends.
"""

from __future__ import annotations

import json
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from multiprocessing import Pipe
from typing import IO, Any, Generic

from pseudolidar.errors import NativeCrash, PseudolidarError, UsageError, WorkerFault
from pseudolidar.running.crew.attempt import AnyFrame, Done, NewResult, Skipped, out_of_memory
from pseudolidar.running.crew.child import FAILED, LOADED, READY
from pseudolidar.running.crew.parcels import new_area, unpacked
from pseudolidar.sources.source import FrameSequence

# A frame whose process died is tried again: the system may have killed it for others' hunger.
TRIES = 2
# Longest start of a process: Python, NumPy, OpenCV and the kernels take 1-2 s.
START_S = 60.0
_PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from pseudolidar.running.crew.child import main; main(*map(int, sys.argv[2:]))"
)
# What C++ and LLVM print before they abort for want of memory.
_HUNGER = re.compile(rb"bad_alloc|out of memory|cannot allocate memory", re.IGNORECASE)
# A line of `faulthandler`, innermost first.
_PLACE = re.compile(r'File "(?:.*[/\\])?([^"/\\]+)", line (\d+) in (\S+)')
_NOISE_BYTES = 100_000  # of the end of what a dead process printed


class Isolation(Generic[AnyFrame, NewResult]):
    """What the processes of a stream are to do.

    Args:
        source: what to read.
        per_frame: what to do with a frame.
        memory_limit_mb: what a process may hold, or None.

    Raises:
        UsageError: the work cannot be sent to another process.
    """

    def __init__(
        self,
        source: FrameSequence[AnyFrame],
        per_frame: Callable[[AnyFrame], NewResult],
        *,
        memory_limit_mb: float | None,
    ) -> None:
        self._ids = source.ids
        try:
            self._job = pickle.dumps((source, per_frame, memory_limit_mb))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise UsageError(
                f"work that cannot be sent to another process: {error}",
                want="a source and functions that pickle",
                fix="Leave out --isolate.",
            ) from error

    def hire(self) -> Isolated[NewResult]:
        """A worker with a process of its own."""
        return Isolated(self._job, self._ids)


class Isolated(Generic[NewResult]):
    """Has frames done by its process, which it starts when it is needed.

    Args:
        job: pickled work.
        ids: names of the source's frames.
    """

    def __init__(self, job: bytes, ids: tuple[str, ...]) -> None:
        self._job, self._ids = job, ids
        self._process: WorkerProcess | None = None
        self._fault: WorkerFault | None = None
        self._ended = False
        self._changing = threading.Lock()  # of the process: `drop` comes from other threads

    def prepare(self) -> None:
        """Start the process, unless it is there."""
        for _ in range(TRIES):
            with self._changing:
                if self._process is not None or self._ended:
                    return
                self._process = process = WorkerProcess()
            try:
                self._fault = process.begin(self._job)
            except EOFError:
                self._fault = _not_begun(process.said())
                self._let_go()

    def do(self, index: int) -> Done[NewResult] | Skipped:
        """Have a frame done; one whose process dies is tried a second time, in a new one."""
        name = self._ids[index]
        error, trace = PseudolidarError("ended"), ""
        for _ in range(TRIES):
            self.prepare()
            process = self._process
            if self._fault is not None or process is None:
                return Skipped(name, index, self._fault or error)
            try:
                outcome: Done[NewResult] | Skipped = process.done(index)
                return outcome
            except EOFError:
                error, trace = process.death(name)
                self._let_go()
        return Skipped(name, index, error, trace)

    def drop(self) -> None:
        """Kill the process, whatever it does, and start no other."""
        self._ended = True
        with self._changing:
            if self._process is not None:
                self._process.kill()

    def end(self) -> None:
        """Kill the process and let go of what was shared with it."""
        self._ended = True
        self._let_go()

    def _let_go(self) -> None:
        with self._changing:
            process, self._process = self._process, None
        if process is not None:
            process.close()


class WorkerProcess:
    """A process that does frames, seen from its parent."""

    def __init__(self) -> None:
        self._channel, theirs = Pipe()
        self._area = new_area()
        self._noise: IO[bytes] = tempfile.TemporaryFile("ab+")  # noqa: SIM115 - lives as long
        self._loaded = False
        shared = (theirs.fileno(), self._area.descriptor)
        numbers = map(str, (*shared, os.getpid()))
        # A group of its own: Ctrl-C is for the parent, which ends its children in order.
        self._process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, json.dumps(sys.path), *numbers],
            stdin=subprocess.DEVNULL,
            stdout=self._noise,
            stderr=self._noise,
            pass_fds=shared,
            process_group=0,
        )
        theirs.close()

    def begin(self, job: bytes) -> WorkerFault | None:
        """Send the work and wait until it is understood; the reason if it is not.

        Raises:
            EOFError: the process died.
        """
        try:
            self._channel.send_bytes(job)
            if not self._channel.poll(START_S):
                return _not_begun(f"no answer within {START_S:g} s")
            answer = self._channel.recv_bytes()
        except OSError as error:
            raise EOFError from error
        return None if answer == READY else _not_begun(answer.removeprefix(FAILED).decode())

    def done(self, index: int) -> Any:
        """The outcome of a frame.

        Raises:
            EOFError: the process died.
        """
        os.ftruncate(self._noise.fileno(), 0)  # what it says now is about this frame
        self._loaded = False
        try:
            self._channel.send(index)
            while (message := self._channel.recv_bytes()) == LOADED:
                self._loaded = True
            return unpacked(message, self._area)
        except OSError as error:
            raise EOFError from error

    def death(self, name: str) -> tuple[PseudolidarError, str]:
        """What a dead process died of while it did frame `name`, and its last words."""
        status, said = self._process.wait(), self.said()
        if status == -signal.SIGABRT and _HUNGER.search(said.encode()):
            return out_of_memory(name, said.strip().splitlines()[0]), said
        place = _PLACE.search(said)
        within = f" in {place[3]} ({place[1]}:{place[2]})" if place else ""
        fix = "Leave the frame out by --exclude, and report this with the file."
        if status == -signal.SIGKILL:
            fix = "Perhaps memory ran out: try fewer --workers. " + fix
        error = NativeCrash(
            f"the process died of {_cause(status)}{within}, {TRIES} times",
            want="a frame that can be processed",
            fix=fix,
            where=f"frame {name}, {'processing' if self._loaded else 'reading'}",
        )
        return error, said

    def kill(self) -> None:
        """End it now; it holds nothing that could be lost."""
        self._process.kill()

    def close(self) -> None:
        """End it, and let go of what was shared with it."""
        self._process.kill()
        self._process.wait()
        self._channel.close()
        self._area.close()
        self._noise.close()

    def said(self) -> str:
        """What it printed, the end of it."""
        descriptor = self._noise.fileno()
        start = max(0, os.fstat(descriptor).st_size - _NOISE_BYTES)
        return os.pread(descriptor, _NOISE_BYTES, start).decode(errors="replace")


def _not_begun(why: str) -> WorkerFault:
    return WorkerFault(
        f"a worker process could not begin: {' '.join(why.split())[-300:] or 'it said nothing'}",
        want="a process that can load the work",
        fix="Leave out --isolate, or allow more by --memory-limit.",
    )


def _cause(status: int) -> str:
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f"exit status {status}"
