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
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pseudolidar import __version__
from pseudolidar.errors import ModelError, OutputError, PseudolidarError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.onnx_model import OnnxModel, read_onnx
from pseudolidar.stereo.networks.layout import NetworkLayout

CACHE_VARIABLE = "PSEUDOLIDAR_CACHE_DIR"
_SCHEMA = 1
_MIB = 1 << 20


@dataclass(frozen=True)
class TrialRequest:
    """What is tried.

    Args:
        known: fields of the layout that flags, metadata or a sidecar settle.
        expected: what the names say.
        probe: find the unknown fields; otherwise take them from what is expected, and only run it.
        iterations: for networks that ask for a number of them.
    """

    known: NetworkLayout
    expected: NetworkLayout
    probe: bool
    iterations: int

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            **asdict(self),
            "known": self.known.as_dict(),
            "expected": self.expected.as_dict(),
        }


@dataclass(frozen=True)
class TrialResult:
    """What a trial found.

    Args:
        layout: complete.
        found: share of a known scene that the network found, None where nobody looked.
        cached: whether an earlier trial found it.
    """

    layout: NetworkLayout
    found: float | None
    cached: bool = False


def cache_folder() -> Path:
    """Where findings are kept: `PSEUDOLIDAR_CACHE_DIR`, or the user's cache."""
    if given := os.environ.get(CACHE_VARIABLE):
        return Path(given)
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "pseudolidar"
    return Path.home() / ".cache" / "pseudolidar"


def tried(
    model: OnnxModel, request: TrialRequest, *, seconds: float, memory_mb: int
) -> TrialResult:
    """The result of the trial, from the cache or from a child process.

    Raises:
        ModelError: the network cannot be used, or outgrows the limits.
    """
    digest = model.sha256()
    place = _cache_place(digest)
    if place is not None and (known := _cached(place, request)) is not None:
        return known
    answer = _ask_child(model, request, seconds=seconds, memory_mb=memory_mb)
    result = TrialResult(NetworkLayout.of_dict(answer["layout"], model.path), answer["found"])
    if place is not None:
        entry = {**_head(request), "sha256": digest, "file": model.path.name, **answer}
        with contextlib.suppress(OutputError):  # a cache that cannot be written is only slower
            write_atomic(place, json.dumps(entry, indent=1).encode() + b"\n")
    return result


def _cache_place(digest: str) -> Path | None:
    with contextlib.suppress(RuntimeError):  # no home folder
        return cache_folder() / "networks" / f"{digest}.json"
    return None


def _head(request: TrialRequest) -> dict[str, Any]:
    import onnxruntime

    return {
        "schema": _SCHEMA,
        "pseudolidar": __version__,
        "onnxruntime": onnxruntime.__version__,
        "asked": request.as_dict(),
    }


def _cached(place: Path, request: TrialRequest) -> TrialResult | None:
    """What the cache holds for this request; None where it holds nothing that can be believed."""
    try:
        entry = json.loads(place.read_bytes())
        if {key: entry.get(key) for key in _head(request)} != _head(request):
            return None
        found = entry["found"]
        return TrialResult(
            NetworkLayout.of_dict(entry["layout"], place),
            None if found is None else float(found),
            cached=True,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ModelError):
        return None


def _ask_child(
    model: OnnxModel, request: TrialRequest, *, seconds: float, memory_mb: int
) -> dict[str, Any]:
    question = {**request.as_dict(), "path": str(model.path), "memory_mb": memory_mb}
    command = [sys.executable, "-m", "pseudolidar.stereo.networks.trial"]
    try:
        ended = subprocess.run(
            command,
            input=json.dumps(question),
            capture_output=True,
            text=True,
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ModelError(
            f"no answer within {seconds:g} s: {model.signature}",
            want="a network that answers",
            fix="It loops for ever, or this processor is slow: raise --matcher.trial-seconds.",
            path=model.path,
        ) from None
    with contextlib.suppress(ValueError, IndexError):
        answer: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
        if "layout" in answer:
            return answer
        raise ModelError(**answer["error"])
    lines = ended.stderr.strip().splitlines() or [f"it ended with {ended.returncode}"]
    raise ModelError(
        f"it kills the process that runs it: {lines[-1][:300]}",
        want=f"a network that runs in {memory_mb} MiB",
        fix="If it is only large, raise --matcher.trial-memory-mb.",
        path=model.path,
    )


def _try(question: dict[str, Any]) -> dict[str, Any]:
    """In the child: run the network, and find its layout where that is asked."""
    from pseudolidar.stereo.networks.probe import find_layout, network_size, try_feed, working_pad
    from pseudolidar.stereo.networks.session import NetworkSession

    path = Path(question["path"])
    known = NetworkLayout.of_dict(question["known"], path)
    expected = NetworkLayout.of_dict(question["expected"], path)
    iterations = question["iterations"]
    session = NetworkSession(read_onnx(path), threads=os.cpu_count() or 1)
    found: float | None = None
    if question["probe"]:
        finding = find_layout(session, known, expected, iterations=iterations)
        layout, found = finding.layout, finding.found
    else:
        layout = known.filled(expected)
        try_feed(session, layout, layout, iterations=iterations)
    layout = layout.filled(NetworkLayout(pad=expected.pad))
    if layout.pad is None:
        free = network_size(session.model, layout.roles) is None
        pad = working_pad(session, layout, iterations=iterations) if free else 1
        layout = layout.filled(NetworkLayout(pad=pad))
    return {"layout": layout.as_dict(), "found": found}


def _limit_memory(megabytes: int) -> None:
    if sys.platform != "win32":
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        limit = megabytes * _MIB
        if hard != resource.RLIM_INFINITY:
            limit = min(limit, hard)
        with contextlib.suppress(ValueError, OSError):  # macOS does not know this limit
            resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def main() -> None:
    """Answer the question on the standard input, with a layout or an error, as JSON."""
    question = json.loads(sys.stdin.read())
    _limit_memory(question["memory_mb"])
    try:
        answer = _try(question)
    except MemoryError:
        answer = {
            "error": {
                "got": f"it needs more than {question['memory_mb']} MiB",
                "fix": "If it is only large, raise --matcher.trial-memory-mb.",
                "path": question["path"],
            }
        }
    except PseudolidarError as error:
        fields = ("got", "want", "fix", "path", "where")
        answer = {"error": {name: getattr(error, name) for name in fields}}
    sys.stdout.write("\n" + json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
