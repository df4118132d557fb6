"""Clouds of frames in which it is written which points are of which obstacle."""

from __future__ import annotations

from collections.abc import Sequence

from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import ENCODERS
from pseudolidar.running.products.found import Found
from pseudolidar.running.products.outputs import file_name


def cloud_files(found: Found, kinds: Sequence[str]) -> list[OutputFile]:
    """The cloud of a frame, with the column `object`, as files.

    Args:
        found: the frame; `object` is 0 for points of none, else the obstacle's `number` in
            `obstacles.jsonl`, which also has its track.
        kinds: of `running.products.compared_outputs.COLUMN_KINDS`: forms of PCD, PLY, NPZ.
    """
    converted = Converted(found.frame, found.cloud)
    return [
        OutputFile.of(file_name(kind, found.frame.id), ENCODERS[kind](converted)) for kind in kinds
    ]
