"""How good a frame is matched: density, and by truth or LiDAR D1 and the error of depth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.disparity import disparity_errors
from pseudolidar.evaluation.ranges import RangeErrors, errors_by_range
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.tuning.judged import reference_px
from pseudolidar.structures.arrays import Float32
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.judged import compared_of

TRUTH, SCAN = "ground truth", "LiDAR"


@dataclass(frozen=True, eq=False)
class Reference:
    """What the disparities of a frame are compared with: its truth, else its scan.

    `compare`, and the tab Compare, take the scan first: they judge depths as a LiDAR measures them.
    Here settings of matchers are judged, and only a truth knows all pixels that gaps are filled at.

    Args:
        by: what it is, in words.
        values: (H, W) px, NaN where nobody knows.
    """

    by: str
    values: Float32

    @classmethod
    def of(cls, frame: StereoFrame) -> Self | None:
        """The truth of a frame, else its scan; None where it has neither, or one of no use."""
        by = TRUTH if frame.truth is not None else SCAN
        if by == SCAN and (frame.scan is None or frame.rig.T_left_velodyne is None):
            return None
        try:
            values = reference_px(frame)
        except PseudolidarError:  # nothing of the scan is in view
            return None
        return cls(by, values) if np.isfinite(values).any() else None


@dataclass(frozen=True)
class FrameFigures:
    """Of one frame, as it is shown: after all filters.

    Args:
        density: share of the pixels that have a disparity.
        points: of the cloud.
        by: what it was compared with; "" where there is nothing.
        d1: share of D1 outliers among the matched pixels that have a reference.
        d1_filled: the same of all that have one, gaps filled.
        depth_rel: median absolute relative error of depth.
        ranges: the same by range.
    """

    density: float
    points: int
    by: str = ""
    d1: float | None = None
    d1_filled: float | None = None
    depth_rel: float | None = None
    ranges: tuple[RangeErrors, ...] = ()


def figures_of(converted: Converted, reference: Reference | None) -> FrameFigures:
    """What a conversion's disparities and points are worth.

    Args:
        converted: of a pair.
        reference: of the same frame.
    """
    assert converted.disparity is not None
    density = float(converted.disparity.valid.mean())
    points = int(np.count_nonzero(converted.cloud.valid))
    if reference is None:
        return FrameFigures(density, points)
    errors = disparity_errors(converted.disparity, DisparityMap(reference.values))
    compared = compared_of(converted, "truth" if reference.by == TRUTH else "scan")
    assert compared is not None  # the frame has that reference
    known = np.isfinite(compared.depth_m)
    found_m, true_m = compared.depth_m[known], compared.reference_m[known]
    relative = np.abs(found_m / true_m - 1.0)
    return FrameFigures(
        density,
        points,
        reference.by,
        errors.d1_est,
        errors.d1_filled,
        float(np.median(relative)) if len(relative) else None,
        errors_by_range(found_m, true_m),
    )


# A column of a table: its heading, how its figure is read, how that is written.
Column = tuple[str, Callable[[FrameFigures], float | None], str]
_COLUMNS: tuple[Column, ...] = (
    ("density", lambda one: one.density, "%"),
    ("D1", lambda one: one.d1, "%"),
    ("D1 filled", lambda one: one.d1_filled, "%"),
    ("depth off", lambda one: one.depth_rel, "%"),
    ("points", lambda one: one.points, ""),
)


def table_of(rows: Sequence[tuple[str, FrameFigures]]) -> str:
    """Figures as a Markdown table, a row each; of two the change from the first to the second too.

    Args:
        rows: name and figures of each, one or two.
    """
    return _table(rows, _COLUMNS)


def range_table_of(rows: Sequence[tuple[str, FrameFigures]]) -> str:
    """Median errors of depth by range, likewise; "" where there is nothing to compare with."""
    bins = max((one.ranges for _, one in rows), key=len, default=())

    def at(place: int) -> Callable[[FrameFigures], float | None]:
        return lambda one: one.ranges[place].median_rel if place < len(one.ranges) else None

    columns = tuple(
        (f"{one.from_m}-{one.to_m} m", at(place), "%") for place, one in enumerate(bins)
    )
    return _table(rows, columns) if columns else ""


def _table(rows: Sequence[tuple[str, FrameFigures]], columns: Sequence[Column]) -> str:
    known = [
        column for column in columns if any(column[1](figures) is not None for _, figures in rows)
    ]
    lines = [_line("", [name for name, _, _ in known]), f"|---{'|---:' * len(known)}|"]
    for name, figures in rows:
        lines.append(_line(name, [_written(read(figures), unit) for _, read, unit in known]))
    if len(rows) > 1:
        first, second = (figures for _, figures in rows)
        changes = [_change(read(first), read(second), unit) for _, read, unit in known]
        lines.append(_line("change", changes))
    return "\n".join(lines)


def _line(name: str, cells: Sequence[str]) -> str:
    return f"| {' | '.join([name, *cells])} |"


def _written(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    return f"{100 * value:.2f} %" if unit == "%" else f"{value:,.0f}"


def _change(first: float | None, second: float | None, unit: str) -> str:
    if first is None or second is None:
        return ""
    change = second - first
    return f"{100 * change:+.2f}" if unit == "%" else f"{change:+,.0f}"
