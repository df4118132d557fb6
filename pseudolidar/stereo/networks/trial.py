"""The trial of a stereo network nobody has run yet: its layout, found in a child process."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pseudolidar.formats.onnx import trial as onnx_trial
from pseudolidar.formats.onnx.model import OnnxModel, read_onnx
from pseudolidar.stereo.networks.layout import NetworkLayout


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


def tried(
    model: OnnxModel, request: TrialRequest, *, seconds: float, memory_mb: int
) -> TrialResult:
    """The result of the trial, from the cache or from a child process.

    Raises:
        ModelError: the network cannot be used, or outgrows the limits.
    """
    limits = onnx_trial.TrialLimits(seconds, memory_mb, "--matcher")
    (layout, found), cached = onnx_trial.tried(__name__, model, request.as_dict(), _read, limits)
    return TrialResult(layout, found, cached)


def _read(answer: dict[str, Any], path: Path) -> tuple[NetworkLayout, float | None]:
    found = answer["found"]
    layout = NetworkLayout.of_dict(answer["layout"], path)
    return layout, None if found is None else float(found)


def _try(path: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """In the child: run the network, and find its layout where that is asked."""
    from pseudolidar.formats.onnx.session import NetworkSession
    from pseudolidar.stereo.networks.probe import find_layout, network_size, try_feed, working_pad

    known = NetworkLayout.of_dict(asked["known"], path)
    expected = NetworkLayout.of_dict(asked["expected"], path)
    iterations = asked["iterations"]
    session = NetworkSession(read_onnx(path), threads=os.cpu_count() or 1)
    found: float | None = None
    if asked["probe"]:
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


def main() -> None:
    """Answer the question on the standard input, with a layout or an error, as JSON."""
    onnx_trial.answer_question(_try)


if __name__ == "__main__":
    main()
