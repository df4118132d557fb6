"""`frames.csv`: how the pose of each frame came about, and which row of which file it is."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.mapping.path import unsure_m
from pseudolidar.running.mapped.walked import Piece, Walked

FRAME_TABLE = "frames.csv"
COLUMNS = ("frame", "index", "timestamp_ns", "status", "sensors", "piece", "row", "sigma_m", "why")


def write_frame_table(folder: Path, walked: Walked) -> Path:
    """Write a line for each frame, lost ones too.

    `sensors` measured the pose; `piece` and `row` count from 1: it is line `row` of the file of
    that piece, of those that are no comment; `sigma_m` is one standard deviation of its place in
    the worst direction.

    Raises:
        OutputError: the disk is full or gone.
    """
    rows = _rows(walked.pieces)
    lines = io.StringIO()
    table = csv.writer(lines, lineterminator="\n")
    table.writerow(COLUMNS)
    for one in walked.placed:
        known = rows.get(one.id, ("", "", ""))
        told = (one.timestamp_ns, one.status, one.sensors)
        table.writerow([one.id, one.index, *told, *known, one.why])
    write_atomic(folder / FRAME_TABLE, lines.getvalue().encode())
    return folder / FRAME_TABLE


def _rows(pieces: Sequence[Piece]) -> Mapping[str, tuple[int, int, str]]:
    return {
        one.id: (number, row, f"{unsure_m(doubt):.4f}")
        for number, piece in enumerate(pieces, 1)
        for row, (one, doubt) in enumerate(zip(piece.frames, piece.covariance, strict=True), 1)
    }
