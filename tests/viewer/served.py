"""`pseudolidar view` as a process of its own, and what it holds of the memory."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from urllib.parse import urlsplit

import psutil

PROGRAM = ("pseudolidar.cli",)
PATIENCE_S = 60.0
# Where bytecode is not kept, all modules are compiled at every start: a second more.
COMPILES = "PYTHONDONTWRITEBYTECODE"


@dataclass
class Served:
    """A viewer that is served by a child.

    Args:
        child: the process.
        begun_s: when it was started, on the clock `time.monotonic`.
    """

    child: subprocess.Popen[str]
    begun_s: float
    url: str = ""
    said: deque[str] = field(default_factory=lambda: deque(maxlen=200))

    def __post_init__(self) -> None:
        self._known = threading.Event()
        threading.Thread(target=self._listen, daemon=True).start()
        assert self._known.wait(PATIENCE_S), "\n".join(self.said)
        assert self.url, "\n".join(self.said)
        self._process = psutil.Process(self.child.pid)

    def _listen(self) -> None:
        assert self.child.stderr is not None
        for line in self.child.stderr:
            self.said.append(line.rstrip())
            if "?token=" in line:
                self.url = line.strip()
                self._known.set()
        self._known.set()

    @property
    def port(self) -> int:
        """Where it listens."""
        port = urlsplit(self.url).port
        assert port is not None
        return port

    @property
    def held_mb(self) -> float:
        """Memory that is its own, and its share of what it has in common with others."""
        return float(self._process.memory_full_info().pss) / 1e6

    @property
    def cpu_s(self) -> float:
        """Processor time that it took so far."""
        times = self._process.cpu_times()
        return float(times.user + times.system)


@contextmanager
def served(arguments: Sequence[str], *, program: Sequence[str] = PROGRAM) -> Iterator[Served]:
    """`pseudolidar view` with these arguments, at any free port, until the block ends.

    Args:
        arguments: behind the verb.
        program: module that has the verb, and what stands before it.
    """
    line = [sys.executable, "-m", *program, "view", *arguments, "--no-browser", "--port", "0"]
    environment = {name: value for name, value in os.environ.items() if name != COMPILES}
    begun_s = time.monotonic()
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True, env=environment) as child:
        try:
            yield Served(child, begun_s)
        finally:
            child.terminate()
            try:
                child.wait(10)
            except subprocess.TimeoutExpired:
                child.kill()
