"""`frames.csv`: how the pose of each frame came about, and which row of which file it is."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.geometry.pose_doubt import unsure_m
from pseudolidar.running.journal.record import FrameRecord
from pseudolidar.running.mapped.walked import Piece, Placed, Walked

FRAME_TABLE = "frames.csv"
NO_ROW = ("", "", "")
COLUMNS = ("frame", "index", "timestamp_ns", "status", "sensors", "piece", "row", "sigma_m", "why")


def write_frame_table(
    folder: Path, walked: Walked, ids: Sequence[str], skipped: Sequence[FrameRecord] = ()
) -> Path:
    """Write a line for each frame: of those that are lost, and of those that were skipped, too.

    `sensors` measured the pose; `piece` and `row` count from 1: it is line `row` of the file of
    that piece, of those that are no comment; `sigma_m` is one standard deviation of its place in
    the worst direction. Of a frame that was skipped nobody saw anything: its status is `skipped`,
    and it is in no piece.

    Args:
        folder: output folder.
        walked: the path.
        ids: of all frames, in order.
        skipped: frames that odometry never saw.

    Returns:
        The file.

    Raises:
        OutputError: the disk is full or gone.
    """
    rows = _rows(walked.pieces)
    lines = io.StringIO()
    table = csv.writer(lines, lineterminator="\n")
    table.writerow(COLUMNS)
    of_each = {one.id: _skipped(one) for one in skipped}
    of_each |= {one.id: _line(one, rows.get(one.id, NO_ROW)) for one in walked.placed}
    table.writerows(of_each[name] for name in ids if name in of_each)
    write_atomic(folder / FRAME_TABLE, lines.getvalue().encode())
    return folder / FRAME_TABLE


def _line(one: Placed, known: tuple[object, ...]) -> list[object]:
    told = (one.timestamp_ns, one.status, one.sensors)
    return [one.id, one.index, *told, *known, one.why]


def _skipped(one: FrameRecord) -> list[object]:
    why = one.skipped or {}
    told = f"{why.get('code')}: {why.get('got')}"
    return [one.id, "", "", "skipped", "none", *NO_ROW, told]


def _rows(pieces: Sequence[Piece]) -> Mapping[str, tuple[int, int, str]]:
    return {
        one.id: (number, row, f"{unsure_m(doubt):.4f}")
        for number, piece in enumerate(pieces, 1)
        for row, (one, doubt) in enumerate(zip(piece.frames, piece.covariance, strict=True), 1)
    }
