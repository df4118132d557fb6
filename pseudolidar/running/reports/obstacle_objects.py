"""Each labelled object beside what was measured of it: for the terminal, and for a page."""

from __future__ import annotations

from collections.abc import Sequence

from pseudolidar.evaluation.obstacles import JudgedObject, by_band, usual_by_band
from pseudolidar.evaluation.page import Section
from pseudolidar.running.reports.numbers import percent
from pseudolidar.running.table import table_text

OBJECT_HEADER = (
    "frame", "object", "label z", "nearest face", "ours", "+-", "off", "usual script", "off z",
)  # fmt: skip
BAND_HEADER = (
    "range", "objects", "median", "90 %", "bias", "within sigma", "missed",
    "usual script: median", "90 %", "without a depth",
)  # fmt: skip
NONE = "-"
# Rows of a page.
MOST_ROWS = 200


def object_rows(objects: Sequence[JudgedObject]) -> list[tuple[str, ...]]:
    """A row of `OBJECT_HEADER` each, in metres.

    Ours is compared with the nearest face, which it measures; the usual script's depth at the
    middle of the box with the z of the label, the middle of the object.
    """
    return [
        (
            one.frame,
            one.name,
            f"{one.label_m:.2f}",
            f"{one.true_m:.2f}",
            _metres(one.measured_m),
            _metres(one.sigma_m),
            _off(one.measured_m, one.true_m),
            _metres(one.usual_m),
            _off(one.usual_m, one.label_m),
        )
        for one in objects
    ]


def objects_text(objects: Sequence[JudgedObject]) -> str:
    """The rows as a table for the terminal."""
    return table_text(object_rows(objects), header=OBJECT_HEADER)


def objects_sections(objects: Sequence[JudgedObject]) -> list[Section]:
    """Errors by range and the rows as parts of a page; none where nothing is labelled."""
    if not objects:
        return []
    left_out = len(objects) - MOST_ROWS
    more = f" {left_out} more are in --json." if left_out > 0 else ""
    return [
        Section(
            "Against the labels",
            "Absolute errors in m by range: of the nearest face in view, and of the usual script, "
            "which reads the depth at the middle of the box, against the label's z.",
            table=_band_rows(objects),
            header=BAND_HEADER,
        ),
        Section(
            "Each labelled object",
            "Distances in m. Ours is that of the nearest face in view; the usual script reads the "
            f"depth at the middle of the box and is compared with the z of the label.{more}",
            table=object_rows(objects[:MOST_ROWS]),
            header=OBJECT_HEADER,
        ),
    ]


def _band_rows(objects: Sequence[JudgedObject]) -> list[tuple[str, ...]]:
    return [
        (
            f"{ours.from_m} to {ours.to_m} m",
            f"{ours.n}",
            _metres(ours.median_abs_m),
            _metres(ours.p90_abs_m),
            NONE if ours.bias_m is None else f"{ours.bias_m:+.2f}",
            percent(ours.within_1_sigma, digits=0),
            f"{ours.missed}",
            _metres(usual.median_abs_m),
            _metres(usual.p90_abs_m),
            f"{usual.missed}",
        )
        for ours, usual in zip(by_band(objects), usual_by_band(objects), strict=True)
    ]


def _metres(value: float | None) -> str:
    return NONE if value is None else f"{value:.2f}"


def _off(value: float | None, true: float) -> str:
    return NONE if value is None else f"{value - true:+.2f}"
