"""Errors by range as a drawing and a table for the page, in its own colours, dark or light."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

from pseudolidar.viewer.comparing.errors import ErrorsByRange, RangeRow

# Source of the colours: Okabe & Ito, Color Universal Design, 2008: told apart by everybody, on dark
# and light. Of the clouds in the order that they are told in.
SERIES = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#F0E442")
# Width and height of one drawing, and what is left around it for numbers, px.
WIDE, HIGH, LEFT, RIGHT, TOP, BOTTOM = 340, 112, 34, 12, 22, 18
PERCENT = 100.0
# Largest value of an axis over the largest one drawn.
HEADROOM = 1.15
FEW_DIGITS = 10.0


@dataclass(frozen=True)
class Panel:
    """One drawing.

    Args:
        title: what it shows.
        field: of `RangeRow`.
        signed: whether values are on both sides of zero.
    """

    title: str
    field: str
    signed: bool = False

    def value(self, row: RangeRow, factor: float) -> float | None:
        """Of a row, in the unit that is drawn."""
        found: float | None = getattr(row, self.field)
        return None if found is None else factor * found


PANELS = (
    Panel("Half of the points are within", "median"),
    Panel("Nine of ten are within", "p90"),
    Panel("Bias: too near (-) or too far (+)", "bias", signed=True),
)


def told(series: Sequence[ErrorsByRange], companions: Sequence[str] = ()) -> str:
    """Drawings, then a table for each, as HTML; everything in it is escaped.

    Args:
        series: judged in the same way, at least one.
        companions: labels of sequences beside the first one, in order: clouds of one have the
            colour that it has in the scene.
    """
    colours = tuple(colour_of(one.name, companions) for one in series)
    unit, factor = ("%", PERCENT) if series[0].way == "depth" else ("m", 1.0)
    drawn = [
        _drawing(panel, series, colours, unit, factor)
        for panel in PANELS
        if any(panel.value(row, factor) is not None for one in series for row in one.rows)
    ]
    tables = [
        _table(one, colour, unit, factor) for one, colour in zip(series, colours, strict=True)
    ]
    return f'<div style="margin:4px 10px;font-size:0.8em">{"".join(drawn + tables)}</div>'


def colour_of(name: str, companions: Sequence[str]) -> str:
    """Of a cloud, by the sequence that it belongs to."""
    places = (i for i, label in enumerate(companions, 1) if name.startswith(f"{label}: "))
    return SERIES[next(places, 0) % len(SERIES)]


def _drawing(
    panel: Panel,
    series: Sequence[ErrorsByRange],
    colours: Sequence[str],
    unit: str,
    factor: float,
) -> str:
    rows = series[0].rows
    values = [[panel.value(row, factor) for row in one.rows] for one in series]
    known = [abs(value) for each in values for value in each if value is not None]
    top = HEADROOM * max([*known, 1e-6])
    low = -top if panel.signed else 0.0
    step = (WIDE - LEFT - RIGHT) / len(rows)

    def x(place: int) -> float:
        return LEFT + (place + 0.5) * step

    def y(value: float) -> float:
        return TOP + (HIGH - TOP - BOTTOM) * (top - value) / (top - low)

    parts = [_text(LEFT, 12, f"{panel.title}, {unit}", anchor="start", bold=True)]
    for at in (0.0, top / HEADROOM, *([-top / HEADROOM] if panel.signed else [])):
        parts.append(
            f'<line x1="{LEFT}" x2="{WIDE - RIGHT}" y1="{y(at):.1f}" y2="{y(at):.1f}" '
            f'stroke="currentColor" stroke-opacity="{0.6 if at == 0 else 0.2}"/>'
        )
        parts.append(_text(LEFT - 4, y(at) + 3, _number(at), anchor="end"))
    for place, row in enumerate(rows):
        parts.append(_text(x(place), HIGH - 5, f"{row.from_m}-{row.to_m} m"))
    for each, colour in zip(values, colours, strict=True):
        points = [(x(i), y(v)) for i, v in enumerate(each) if v is not None]
        path = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" fill="{colour}"/>' for a, b in points]
    return (
        f'<svg viewBox="0 0 {WIDE} {HIGH}" width="100%" role="img" '
        f'aria-label="{html.escape(panel.title)}">{"".join(parts)}</svg>'
    )


def _text(x: float, y: float, words: str, *, anchor: str = "middle", bold: bool = False) -> str:
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="10" text-anchor="{anchor}"{weight} '
        f'fill="currentColor">{html.escape(words)}</text>'
    )


def _table(one: ErrorsByRange, colour: str, unit: str, factor: float) -> str:
    covered = "covered" if one.way == "depth" else "within 0.2 m"
    heads = ("range", "points", "half within", "9 of 10", "bias", covered)
    lines = [_row(heads, "th")]
    for row in (*one.rows, one.overall):
        where = f"{row.from_m}-{row.to_m} m" if row is not one.overall else "all"
        errors = [
            "-" if value is None else f"{factor * value:{sign}.2f} {unit}"
            for value, sign in ((row.median, ""), (row.p90, ""), (row.bias, "+"))
        ]
        share = "-" if row.covered is None else f"{PERCENT * row.covered:.0f} %"
        lines.append(_row((where, f"{row.n:,}", *errors, share), "td"))
    frames = "1 frame" if one.frames == 1 else f"{one.frames} frames"
    title = f"{html.escape(one.name)} against {html.escape(one.against)}, {frames}"
    return (
        f'<div style="margin-top:8px"><span style="color:{colour}">&#9679;</span> <b>{title}</b>'
        f'<table style="width:100%;border-spacing:0;white-space:nowrap">{"".join(lines)}</table>'
        "</div>"
    )


def _row(cells: Sequence[str], kind: str) -> str:
    style = "text-align:right;padding:0 2px;font-weight:normal"
    told = "".join(f'<{kind} style="{style}">{cell}</{kind}>' for cell in cells)
    return f"<tr>{told}</tr>"


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= FEW_DIGITS or value == 0 else f"{value:.2g}"
