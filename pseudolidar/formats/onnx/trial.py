"""The trial of a network file nobody has run yet, in a child process that may not outgrow limits.

A graph can loop for ever or ask for all memory, and onnxruntime has no limit for either. What a
trial found is kept in the user's cache by the hash of the file.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pseudolidar import __version__
from pseudolidar.errors import ModelError, OutputError, PseudolidarError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.onnx.model import OnnxModel

CACHE_VARIABLE = "PSEUDOLIDAR_CACHE_DIR"
_SCHEMA = 1
_MIB = 1 << 20

Json = dict[str, Any]
Result = TypeVar("Result")


@dataclass(frozen=True)
class TrialLimits:
    """What a trial may cost.

    Args:
        seconds: of time.
        memory_mb: of address space, MiB.
        flag: of the command line that chose the network.
    """

    seconds: float
    memory_mb: int
    flag: str


def cache_folder() -> Path:
    """Where findings are kept: `PSEUDOLIDAR_CACHE_DIR`, or the user's cache."""
    if given := os.environ.get(CACHE_VARIABLE):
        return Path(given)
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "pseudolidar"
    return Path.home() / ".cache" / "pseudolidar"


def tried(
    module: str,
    model: OnnxModel,
    asked: Json,
    read: Callable[[Json, Path], Result],
    limits: TrialLimits,
) -> tuple[Result, bool]:
    """The result of a trial, and whether an earlier one found it.

    Args:
        module: run as a program; its `main` calls `answer_question`.
        model: the network.
        asked: what is asked about it, plain JSON values.
        read: the result of an answer; may raise what damaged JSON raises, or `ModelError`.
        limits: of time and memory.

    Raises:
        ModelError: the network cannot be used, or outgrows the limits.
    """
    digest = model.sha256()
    place, head = _cache_place(digest), _head(asked)
    if place is not None and (known := _cached(place, head, read)) is not None:
        return known, True
    answer = _ask_child(module, model, asked, limits)
    if place is not None:
        entry = {**head, "sha256": digest, "file": model.path.name, **answer}
        with contextlib.suppress(OutputError):  # a cache that cannot be written is only slower
            write_atomic(place, json.dumps(entry, indent=1).encode() + b"\n")
    return read(answer, model.path), False


def _cache_place(digest: str) -> Path | None:
    with contextlib.suppress(RuntimeError):  # no home folder
        return cache_folder() / "networks" / f"{digest}.json"
    return None


def _head(asked: Json) -> Json:
    import onnxruntime

    return {
        "schema": _SCHEMA,
        "pseudolidar": __version__,
        "onnxruntime": onnxruntime.__version__,
        "asked": asked,
    }


def _cached(place: Path, head: Json, read: Callable[[Json, Path], Result]) -> Result | None:
    """What the cache holds for this question; None where it holds nothing to be believed."""
    try:
        entry = json.loads(place.read_bytes())
        if {key: entry.get(key) for key in head} != head:
            return None
        return read(entry, place)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ModelError):
        return None


def _ask_child(module: str, model: OnnxModel, asked: Json, limits: TrialLimits) -> Json:
    flag = limits.flag
    question = {"asked": asked, "path": str(model.path), "memory_mb": limits.memory_mb}
    try:
        ended = subprocess.run(
            [sys.executable, "-m", module],
            input=json.dumps({**question, "flag": flag}),
            capture_output=True,
            text=True,
            timeout=limits.seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ModelError(
            f"no answer within {limits.seconds:g} s: {model.signature}",
            want="a network that answers",
            fix=f"It loops for ever, or this processor is slow: raise {flag}.trial-seconds.",
            path=model.path,
        ) from None
    with contextlib.suppress(ValueError, IndexError, KeyError, TypeError):
        answer: Json = json.loads(ended.stdout.splitlines()[-1])
        if "error" not in answer:
            found: Json = answer["answer"]
            return found
        raise ModelError(**answer["error"])
    lines = ended.stderr.strip().splitlines() or [f"it ended with {ended.returncode}"]
    raise ModelError(
        f"it kills the process that runs it: {lines[-1][:300]}",
        want=f"a network that runs in {limits.memory_mb} MiB",
        fix=f"If it is only large, raise {flag}.trial-memory-mb.",
        path=model.path,
    )


def answer_question(answer: Callable[[Path, Json], Json]) -> None:
    """In the child: answer the question on the standard input, as JSON, or tell the error.

    Args:
        answer: of the path of the network and what is asked.
    """
    question = json.loads(sys.stdin.read())
    _limit_memory(question["memory_mb"])
    reply: Json
    try:
        reply = {"answer": answer(Path(question["path"]), question["asked"])}
    except MemoryError:
        reply = {
            "error": {
                "got": f"it needs more than {question['memory_mb']} MiB",
                "fix": f"If it is only large, raise {question['flag']}.trial-memory-mb.",
                "path": question["path"],
            }
        }
    except PseudolidarError as error:
        fields = ("got", "want", "fix", "path", "where")
        reply = {"error": {name: getattr(error, name) for name in fields}}
    sys.stdout.write("\n" + json.dumps(reply) + "\n")


def _limit_memory(megabytes: int) -> None:
    if sys.platform != "win32":
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        limit = megabytes * _MIB
        if hard != resource.RLIM_INFINITY:
            limit = min(limit, hard)
        with contextlib.suppress(ValueError, OSError):  # macOS does not know this limit
            resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
