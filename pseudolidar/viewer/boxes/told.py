"""Figures of a box as a table, a column for each cloud."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping

from pseudolidar.structures.arrays import Float64
from pseudolidar.viewer.boxes.figures import BoxFigures, Flatness

NONE = "no points in the box"
# Planes of up to so many degrees from level are grounds, from upright walls.
NEAR_DEG = 20.0
TABLE = """<div style="margin:2px 10px;overflow-x:auto"><table style="font-size:0.8em;
border-spacing:0 2px">{rows}</table></div>"""


def table(figures: Mapping[str, BoxFigures]) -> str:
    """HTML of the figures of clouds by name."""
    if not figures:
        return f'<div style="margin:2px 10px;font-size:0.85em">{NONE}</div>'
    rows = _row("", [html.escape(name) for name in figures], "th")
    for title, cell in CELLS.items():
        cells = [cell(one) for one in figures.values()]
        rows += _row(title, cells) if any(cells) else ""
    return TABLE.format(rows=rows)


def _row(title: str, cells: list[str], kind: str = "td") -> str:
    shown = "".join(f'<{kind} style="padding-left:10px">{cell}</{kind}>' for cell in cells)
    return f'<tr style="vertical-align:top"><td style="opacity:0.7">{title}</td>{shown}</tr>'


def _points(one: BoxFigures) -> str:
    some = f" of some {one.whole:,} near it, the coarsest" if one.whole is not None else ""
    return f"{len(one.points):,}{some}"


def _lengths(lengths_m: Float64) -> str:
    return " &times; ".join(f"{length:.2f}" for length in lengths_m)


def _place(place_m: Float64) -> str:
    return ", ".join(f"{each:.2f}" for each in place_m)


def _of_plane(tell: Callable[[Flatness], str]) -> Callable[[BoxFigures], str]:
    return lambda one: "" if one.flatness is None else tell(one.flatness)


def _plane(flat: Flatness) -> str:
    tilt = flat.tilt_deg
    if tilt <= NEAR_DEG:
        return f"level, {tilt:.1f}° off"
    return f"upright, {90 - tilt:.1f}° off" if tilt >= 90 - NEAR_DEG else f"slanted by {tilt:.1f}°"


def _expected(flat: Flatness) -> str:
    if flat.expected_m is None:
        return ""
    most = "" if flat.seen else "at most "
    verdict = "flat within that" if flat.rms_m <= flat.expected_m else "more uneven than that"
    return f"{most}{1000 * flat.expected_m:.1f} mm: {verdict}"


def _density(flat: Flatness) -> str:
    return "" if flat.per_m2 is None else f"{flat.per_m2:,.0f} per m²"


CELLS: Mapping[str, Callable[[BoxFigures], str]] = {
    "points": _points,
    "middle in its frame, m": lambda one: _place(one.middle_m),
    "along the box, m": lambda one: _lengths(one.along_m),
    "along own axes, m": lambda one: _lengths(one.own_m),
    "plane": _of_plane(_plane),
    "normal in the map": _of_plane(lambda flat: ", ".join(f"{each:.3f}" for each in flat.normal)),
    "its middle in its frame, m": _of_plane(lambda flat: _place(flat.own_middle_m)),
    "on the plane": _of_plane(lambda flat: f"{100 * flat.share:.1f} %"),
    "from it, RMS": _of_plane(lambda flat: f"{1000 * flat.rms_m:.1f} mm"),
    "95 % within": _of_plane(lambda flat: f"{1000 * flat.most_m:.1f} mm"),
    "expected by σ": _of_plane(_expected),
    "density": _of_plane(_density),
}
