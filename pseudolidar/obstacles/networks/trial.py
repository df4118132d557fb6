"""The trial of a detector nobody has run yet: its layout, found in a child process."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from pseudolidar.formats.onnx import trial as onnx_trial
from pseudolidar.formats.onnx.description import of_values
from pseudolidar.formats.onnx.model import OnnxModel, read_onnx
from pseudolidar.formats.onnx.trial import TrialLimits
from pseudolidar.obstacles.networks.layout import DetectorLayout
from pseudolidar.structures.image_size import ImageSize


def tried(
    model: OnnxModel, known: DetectorLayout, size: ImageSize, limits: TrialLimits
) -> tuple[DetectorLayout, bool]:
    """The complete layout of a network, and whether an earlier trial found it.

    Args:
        model: the network.
        known: what flags, metadata or a sidecar settle.
        size: of the input, where the network has none of its own.
        limits: of time and memory.

    Raises:
        ModelError: the network cannot be used, or outgrows the limits.
    """
    asked = {"known": known.as_dict(), "size": str(size), "detector": True}
    return onnx_trial.tried(__name__, model, asked, _read, limits)


def _read(answer: dict[str, Any], path: Path) -> DetectorLayout:
    return of_values(DetectorLayout, answer["layout"], path)


def _try(path: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """In the child: run the network, and find its layout."""
    from pseudolidar.formats.onnx.session import NetworkSession
    from pseudolidar.obstacles.networks.recognise import found_out

    known = of_values(DetectorLayout, asked["known"], path)
    threads = os.cpu_count() or 1
    session = NetworkSession(read_onnx(path), threads=threads, flag="--detector")
    layout = found_out(session, known, ImageSize.parse(asked["size"]))
    return {"layout": layout.as_dict()}


def main() -> None:
    """Answer the question on the standard input, with a layout or an error, as JSON."""
    onnx_trial.answer_question(_try)


if __name__ == "__main__":
    main()
