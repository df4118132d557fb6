"""Distances between clouds by range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.bins import DepthBins
from pseudolidar.evaluation.comparison.clouds import F_RADII_M, CloudFigures
from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREEN,
    VERMILLION,
    depth_axis,
    new_figure,
    nothing,
    with_intervals,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# What the plot of distances shows.
DRAWN = tuple(
    f"{side}_{name}_m" for side in ("accuracy", "completeness") for name in ("median", "p90")
)


def distances_plot(by_range: Sequence[CloudFigures], bins: DepthBins) -> Figure:
    """Accuracy and completeness, medians and 90th percentiles, by range.

    Args:
        by_range: figures of every bin; whiskers are their intervals.
        bins: of the points' range.
    """
    figure, axes = new_figure(5.4, 3.6)
    for side, colour in (("accuracy", BLUE), ("completeness", VERMILLION)):
        for name, marker, style, words in (
            (f"{side}_median_m", "o", "-", "median"),
            (f"{side}_p90_m", "s", "--", "90th percentile"),
        ):
            known = [i for i, each in enumerate(by_range) if each.figures[name] is not None]
            at = np.array([by_range[i].figures[name] for i in known], np.float64)
            bounds = [
                by_range[i].intervals.get(name) or (by_range[i].figures[name],) * 2 for i in known
            ]
            reach = np.abs(np.array(bounds, np.float64).reshape(-1, 2).T - at)
            axes.errorbar(
                known,
                at,
                yerr=reach,
                fmt=marker + style,
                color=colour,
                capsize=3,
                markersize=5,
                label=f"{side}, {words}",
            )
    if any(each.n and each.reference for each in by_range):
        axes.legend(frameon=False, fontsize=9, loc="lower right")
    else:
        nothing(axes)
    axes.set(title="Distance to the nearest neighbour", ylabel="distance, m")
    if any((each.figures[name] or 0.0) > 0 for each in by_range for name in DRAWN):
        _metres_by_factors(axes)
    depth_axis(axes, list(bins))
    axes.set_xlabel("range of the point, m")
    return figure


def _metres_by_factors(axes: Axes) -> None:
    """A logarithmic axis of lengths, as near and far differ by a hundred, with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(base=10, subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda length_m, _: f"{length_m:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def scores_plot(by_range: Sequence[CloudFigures], bins: DepthBins) -> Figure:
    """F-score by range at each radius.

    Args:
        by_range: figures of every bin.
        bins: of the points' range.
    """
    figure, axes = new_figure(5.4, 3.6)
    looks = ((BLUE, "o"), (GREEN, "s"), (VERMILLION, "D"))
    for radius, (colour, marker) in zip(F_RADII_M, looks, strict=True):
        name = f"f_score_{radius:g}".replace(".", "_")
        with_intervals(
            axes,
            [each.figures[name] for each in by_range],
            [each.intervals.get(name) for each in by_range],
            colour=colour,
            marker=marker,
            label=f"within {radius:g} m",
            digits=0,
            below=radius < max(F_RADII_M),
            numbers=radius > min(F_RADII_M),  # its low numbers would lie on those above
        )
    if any(each.n and each.reference for each in by_range):
        axes.legend(frameon=False, fontsize=9, loc="lower left")
    axes.set(title="F-score", ylabel="F-score, %", ylim=(-9, 112))
    axes.set_yticks(range(0, 101, 20))
    depth_axis(axes, list(bins))
    axes.set_xlabel("range of the point, m")
    return figure
