"""Boxes in pictures that somebody drew: CSV or JSON, by frame.

CSV: a header with `left`, `top`, `right`, `bottom` (px, first pixel centre at 0), and optionally
`frame` (id; a row without one is of every frame), `class` and `score`. JSON: a list of objects with
the same names.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pseudolidar.errors import LabelError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import NUMBER, read_lines
from pseudolidar.structures.box import Detection

EDGES = ("left", "top", "right", "bottom")
OPTIONAL = ("frame", "class", "score")
EVERY_FRAME = ""
NO_CLASS = "region"
LONGEST_SHOWN = 40


def read_regions(
    path: Path, *, limits: Limits = DEFAULT_LIMITS
) -> dict[str, tuple[Detection, ...]]:
    """Boxes by the id of their frame; under `EVERY_FRAME` those of all frames.

    Args:
        path: a .csv or .json file.
        limits: cap on its size.

    Raises:
        LabelError: missing file, a column or key is missing or unknown, no number, edges the wrong
            way round; by line or by number of the object.
    """
    lines = read_lines(path, error=LabelError, limits=limits)
    text = "\n".join(line.text for line in lines)
    records = _json_records if text.lstrip()[:1] in "[{" and text.strip() else _csv_records
    found: dict[str, list[Detection]] = {}
    for where, record in records(text, path):
        frame, detection = _region(record, path, where)
        found.setdefault(frame, []).append(detection)
    return {frame: tuple(detections) for frame, detections in found.items()}


def _csv_records(text: str, path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    rows = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    names = [name.strip() for name in rows.fieldnames or ()]
    _check_names(names, path, "line 1")
    rows.fieldnames = names
    for row in rows:
        where = f"line {rows.line_num}"
        if None in row or None in row.values():
            count = len(names) + len(row.get(None) or ()) - list(row.values()).count(None)
            raise LabelError(
                f"{count} values", want=f"{len(names)}, as the header", path=path, where=where
            )
        yield where, {name: value for name, value in row.items() if value.strip()}


def _json_records(text: str, path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    try:
        records = json.loads(text)
    except (ValueError, RecursionError) as error:
        line = getattr(error, "lineno", 1)
        raise LabelError(
            "no JSON", want="a list of objects", path=path, where=f"line {line}"
        ) from error
    if not isinstance(records, list):
        raise LabelError(
            f"a JSON {type(records).__name__}", want="a list of objects", path=path, where="line 1"
        )
    for number, record in enumerate(records):
        where = f"object {number}"
        if not isinstance(record, dict):
            raise LabelError(
                f"{str(record)[:LONGEST_SHOWN]!r}", want="an object", path=path, where=where
            )
        _check_names(list(record), path, where)
        yield where, record


def _check_names(names: list[str], path: Path, where: str) -> None:
    missing = [name for name in EDGES if name not in names]
    unknown = [name for name in names if name not in (*EDGES, *OPTIONAL)]
    if missing or unknown or len(set(names)) < len(names):
        got = ", ".join(name[:LONGEST_SHOWN] for name in names) or "nothing"
        raise LabelError(
            f"the names {got}",
            want=f"{', '.join(EDGES)}, and at most {', '.join(OPTIONAL)}",
            path=path,
            where=where,
        )


def _region(record: Mapping[str, Any], path: Path, where: str) -> tuple[str, Detection]:
    left, top, right, bottom = (_number(record, name, path, where) for name in EDGES)
    if not (left < right and top < bottom):
        raise LabelError(
            f"box {left:g},{top:g},{right:g},{bottom:g}",
            want="left < right and top < bottom",
            path=path,
            where=where,
        )
    score = _number(record, "score", path, where) if "score" in record else 1.0
    if not 0 <= score <= 1:
        raise LabelError(f"score {score:g}", want="0 to 1", path=path, where=where)
    name = str(record.get("class") or NO_CLASS)
    told = record.get("frame")  # 0 is a frame too
    frame = EVERY_FRAME if told is None else str(told).strip()
    return frame, Detection(name, (left, top, right, bottom), score)


def _number(record: Mapping[str, Any], name: str, path: Path, where: str) -> float:
    value = record.get(name)
    if isinstance(value, str) and NUMBER.fullmatch(value.strip()):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        shown = "nothing" if value is None else f"{str(value)[:LONGEST_SHOWN]!r}"
        raise LabelError(f"{name} {shown}", want="a finite number", path=path, where=where)
    return float(value)
