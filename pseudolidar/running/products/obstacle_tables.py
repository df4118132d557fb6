"""`obstacles.jsonl` and `obstacles.csv`: one line for each obstacle of each frame."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from typing import Any

# Columns of the CSV, and where each value is among the fields of an obstacle.
CENTRE = ("along", "across", "upright")  # the axes of the box
COLUMNS: tuple[tuple[str, str, int | str | None], ...] = (
    *((name, name, None) for name in ("frame", "time_s", "number", "class", "score")),
    *((name, name, None) for name in ("distance_m", "sigma_distance_m")),
    *((f"{axis}_m", "centre_m", i) for i, axis in enumerate("xyz")),
    *((f"{name}_m", "size_m", i) for i, name in enumerate(("length", "width", "height"))),
    *(
        (f"sigma_{name}_m", "sigma_size_m", i)
        for i, name in enumerate(("length", "width", "height"))
    ),
    *((name, name, None) for name in ("heading_rad", "sigma_heading_rad", "points", "confidence")),
    *((name, name, None) for name in ("truncated", "occluded", "measured_by", "bound")),
    *((name, "box_px", i) for i, name in enumerate(("left", "top", "right", "bottom"))),
    *((f"sigma_{name}_m", "sigma_centre_m", i) for i, name in enumerate(CENTRE)),
    *((name, name, None) for name in ("track", "track_state", "unseen_s", "over_ground")),
    *((f"velocity_{axis}_m_s", "velocity_m_s", i) for i, axis in enumerate("xyz")),
    *((f"sigma_velocity_{axis}_m_s", "sigma_velocity_m_s", i) for i, axis in enumerate("xyz")),
    *((name, name, None) for name in ("speed_m_s", "sigma_speed_m_s")),
    *((f"{prefix}contact_s", "contact", f"{prefix}time_s") for prefix in ("", "sigma_")),
)


def encode_jsonl(obstacles: Iterable[Mapping[str, Any]]) -> bytes:
    """Every field of each obstacle, one JSON object a line."""
    return "".join(f"{json.dumps(dict(one))}\n" for one in obstacles).encode()


def encode_csv(obstacles: Iterable[Mapping[str, Any]]) -> bytes:
    """The usual columns, the first line their names, lengths to a millimetre or finer."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow([name for name, _, _ in COLUMNS])
    for one in obstacles:
        rows.writerow([_cell(field, _value(one, field, at)) for _, field, at in COLUMNS])
    return text.getvalue().encode()


def _value(one: Mapping[str, Any], field: str, at: int | str | None) -> Any:
    """A field or a part of it; None, an empty cell, where the obstacle has none."""
    value = one.get(field)
    return value if at is None or value is None else value[at]


def _cell(field: str, value: Any) -> Any:
    """A number as text: times to a microsecond, all else to nine digits."""
    if not isinstance(value, float):
        return value
    return f"{value:.6f}" if field == "time_s" else f"{value:.9g}"
