"""The commands, with pictures of the street so small that all is made often; and with a leak.

    python -m tests.viewer.soaked_view KEPT_BYTES view synthetic:street:4 ...

So many bytes of every frame that is drawn are kept for ever: what a soak must see. 0 for none.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

from pseudolidar import cli
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.viewer import opening
from pseudolidar.viewer.stage import Stage

WIDTH_PX = 480
_kept: list[bytes] = []


def _small(path: str) -> Any:
    source = recognise(path)
    return replace(source, width_px=WIDTH_PX) if isinstance(source, Synthetic) else source


def _leak(kept_bytes: int) -> None:
    show = Stage.show

    def shown(stage: Stage, moment: Any) -> None:
        show(stage, moment)
        _kept.append(b"x" * kept_bytes)

    Stage.show = shown  # type: ignore[method-assign]


if __name__ == "__main__":
    opening.recognise = _small
    if kept_bytes := int(sys.argv.pop(1)):
        _leak(kept_bytes)
    cli.program()
