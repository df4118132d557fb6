"""A pipeline of a user's own, for the tests of the command line.

Examples:
    pseudolidar run example_job.py folder:a out --matcher blocks
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pseudolidar.errors import OutputError, SourceUnknown, StereoConfig
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, Recognised
from pseudolidar.running.settings_json import to_json


@dataclass(frozen=True)
class KittiRaw:
    """KITTI raw data.

    Args:
        path: the drive's folder.
        camera: which pair.
    """

    path: Path
    camera: Literal["colour", "grey"] = "colour"


@dataclass(frozen=True)
class World:
    """A rendered world.

    Args:
        name: which world.
        seed: of everything random.
        rain: whether it rains.
    """

    name: Literal["street", "room"]
    seed: int = 0
    rain: bool = False


def recognise(text: str) -> KittiRaw | World:
    if text.startswith("world:"):
        return World(text.partition(":")[2])  # type: ignore[arg-type]
    if "kitti" in text:
        return KittiRaw(Path(text))
    raise SourceUnknown("no such source", path=text)


@dataclass(frozen=True)
class Census:
    """Matches by census.

    Args:
        quality: fast or fine.
        disparities: searched, px.
    """

    quality: Literal["fast", "fine"] = "fast"
    disparities: int | None = None


@dataclass(frozen=True)
class BlockMatch:
    """Matches by blocks.

    Args:
        block_size: odd, px.
    """

    block_size: int = 5

    def __post_init__(self) -> None:
        if self.block_size % 2 == 0:
            raise StereoConfig(f"block size {self.block_size}", want="an odd number")


@dataclass(frozen=True)
class Nothing:
    """Has nothing to set."""


@dataclass(frozen=True)
class Formats:
    names: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        if "doc" in text:
            raise ValueError("doc is no format")
        return cls(tuple(text.split(",")))

    def __str__(self) -> str:
        return ",".join(self.names)


@dataclass(frozen=True)
class Job:
    """Turn pairs into clouds.

    Args:
        source: what to convert.
        out: folder of the results.
        matcher: how disparity is found.
        gate: a gate, or none.
        to: formats to write.
        workers: processes that match,
            two by default.
        noisy: print to the standard output from Python and from C.
        shift: added to every disparity, px.
        fail: how to end.
    """

    source: Annotated[KittiRaw | World, Recognised(recognise)]
    out: Annotated[Path | None, POSITIONAL] = None
    matcher: Census | BlockMatch | Nothing = Census()
    gate: BlockMatch | None = None
    to: Formats = Formats(("pcd",))
    workers: Annotated[int, RUN_ONLY] = 2
    noisy: bool = False
    shift: float = 0.0
    fail: Literal["no", "bug", "disk", "sigint", "sigterm", "skip", "import"] = "no"


@dataclass(frozen=True)
class Result:
    job: Job
    exit_code: int

    def as_dict(self) -> dict[str, Any]:
        return {"settings": to_json(self.job), "error_m": float("nan")}

    def text(self) -> str:
        return repr(self.job)


def run(job: Job) -> Result:
    if job.noisy:
        print("noise", file=sys.stdout)  # noqa: T201
        sys.stdout.flush()
        libc = ctypes.CDLL(None)
        libc.puts(b"noise from C")
        libc.fflush(None)
    match job.fail:
        case "bug":
            raise ValueError("a bug\nin two lines")
        case "disk":
            raise OutputError("disk full", path="out")
        case "sigint" | "sigterm":
            os.kill(os.getpid(), signal.SIGINT if job.fail == "sigint" else signal.SIGTERM)
            time.sleep(10)
        case "import":
            import no_such_library_anywhere  # type: ignore[import-not-found]  # noqa: F401
    return Result(job, 4 if job.fail == "skip" else 0)
