"""Depth error by range: median, 90th percentile, bias, with 95 % intervals over frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pseudolidar.evaluation.comparison.figures import RangeFigures
from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREEN,
    PERCENT,
    VERMILLION,
    depth_axis,
    headroom,
    new_figure,
    with_intervals,
    zero_line,
)
from pseudolidar.evaluation.diagnosis.diagnosis import BiasShare

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANELS = (
    ("median_rel", "Half of the points are within", "median error, %", BLUE, "o"),
    ("p90_rel", "Nine of ten points are within", "90th percentile of the error, %", GREEN, "s"),
    ("bias_rel", "Bias: too near (-) or too far (+)", "signed median error, %", VERMILLION, "D"),
)
# Values of at least this many percent are written without decimals.
COARSE_PERCENT = 100.0


def range_error_plot(by_range: Sequence[RangeFigures]) -> Figure:
    """Median, 90th percentile and bias of the relative depth error, one panel each.

    Args:
        by_range: figures of every bin; whiskers are their intervals.
    """
    figure, panels = new_figure(11.0, 3.4, ncols=3)
    for axes, (name, title, label, colour, marker) in zip(panels, _PANELS, strict=True):
        signed = name == "bias_rel"
        values = [getattr(each.figures, name) for each in by_range]
        largest = max((abs(PERCENT * v) for v in values if v is not None), default=0.0)
        with_intervals(
            axes,
            values,
            [each.figures.intervals.get(name) for each in by_range],
            colour=colour,
            marker=marker,
            digits=0 if largest >= COARSE_PERCENT else 1,
            signed=signed,
        )
        if signed:
            zero_line(axes)
        axes.set(title=title, ylabel=label)
        depth_axis(axes, [(each.from_m, each.to_m) for each in by_range])
        headroom(axes, from_zero=not signed)
    return figure


def coverage_plot(by_range: Sequence[RangeFigures]) -> Figure:
    """Share of the reference points that stereo has a point for.

    Args:
        by_range: figures of every bin.
    """
    figure, axes = new_figure()
    with_intervals(
        axes,
        [each.figures.density for each in by_range],
        [each.figures.intervals.get("density") for each in by_range],
        colour=BLUE,
        marker="o",
        digits=0,
    )
    axes.set(title="Reference points that stereo has", ylabel="share, %", ylim=(0, 112))
    axes.set_yticks(range(0, 101, 20))
    depth_axis(axes, [(each.from_m, each.to_m) for each in by_range])
    return figure


def inlier_plot(by_range: Sequence[RangeFigures]) -> Figure:
    """Share of the points whose depth is off by less than 1.05 and than 1.25.

    Args:
        by_range: figures of every bin.
    """
    figure, axes = new_figure()
    for name, colour, marker, factor in (
        ("delta_1_25", GREEN, "s", "1.25"),
        ("delta_1_05", BLUE, "o", "1.05"),
    ):
        with_intervals(
            axes,
            [getattr(each.figures, name) for each in by_range],
            [each.figures.intervals.get(name) for each in by_range],
            colour=colour,
            marker=marker,
            label=f"off by less than the factor {factor}",
            digits=0,
            below=name == "delta_1_05",
        )
    axes.set(title="Points without a large error", ylabel="share of the points, %", ylim=(0, 112))
    axes.set_yticks(range(0, 101, 20))
    depth_axis(axes, [(each.from_m, each.to_m) for each in by_range])
    if any(each.figures.n for each in by_range):
        axes.legend(frameon=False, fontsize=9, loc="lower left")
    return figure


def explained_bias_plot(bias: Sequence[BiasShare]) -> Figure:
    """Depth bias by range, and what the named causes make of it.

    Args:
        bias: of the diagnosis.
    """
    figure, axes = new_figure(10.5, 3.0)
    for values, colour, marker, label in (
        ([each.bias_rel for each in bias], VERMILLION, "D", "measured"),
        ([each.explained_rel for each in bias], BLUE, "o", "explained by the causes"),
    ):
        known = [i for i, value in enumerate(values) if value is not None]
        shares = [PERCENT * value for value in values if value is not None]
        style = "-" if marker == "D" else "--"
        axes.plot(known, shares, style, marker=marker, color=colour, label=label)
    zero_line(axes)
    axes.set(title="Bias of image blocks", ylabel="signed median error, %")
    depth_axis(axes, [(each.from_m, each.to_m) for each in bias])
    axes.legend(frameon=False, fontsize=9)
    return figure
