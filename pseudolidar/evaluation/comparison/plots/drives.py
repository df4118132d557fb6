"""Many drives side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.figures import DepthFigures
from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREY,
    PERCENT,
    VERMILLION,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDE_IN, PER_DRIVE_IN, AROUND_IN = 10.5, 0.28, 1.3
# Drives that are drawn, those of the largest medians: more would not be read.
MOST_DRIVES = 60


def drives_plot(drives: Mapping[str, DepthFigures]) -> Figure:
    """Median, 90th percentile and bias of every drive, the largest median on top.

    Args:
        drives: figures of all points of each drive; whiskers are their intervals.
    """
    known = [(name, each) for name, each in drives.items() if each.median_rel is not None]
    known.sort(key=lambda pair: pair[1].median_rel or 0.0)
    known = known[-MOST_DRIVES:]
    figure, (size, bias) = new_figure(
        WIDE_IN, AROUND_IN + PER_DRIVE_IN * max(3, len(known)), ncols=2, sharey=True
    )
    rows = np.arange(len(known))
    for axes, name, colour, marker, label in (
        (size, "p90_rel", GREY, "s", "90th percentile"),
        (size, "median_rel", BLUE, "o", "median"),
        (bias, "bias_rel", VERMILLION, "D", ""),
    ):
        at = PERCENT * np.array([getattr(each, name) for _, each in known], np.float64)
        bounds = [each.intervals.get(name) or (getattr(each, name),) * 2 for _, each in known]
        ends = PERCENT * np.array(bounds, np.float64).reshape(-1, 2)
        reach = np.abs(ends.T - at)
        axes.errorbar(at, rows, xerr=reach, fmt=marker, color=colour, capsize=3, label=label)
    size.set_yticks(rows, [name for name, _ in known])
    size.set(xlabel="relative depth error, %", xlim=(0, None))
    size.set_title("Median and 90th percentile")
    size.set_ylim(-0.6, len(known) - 0.4)
    figure.legend(frameon=False, fontsize=9, loc="outside lower center", ncols=2)
    bias.axvline(0.0, color="black", linewidth=0.9)
    bias.set(xlabel="signed median error, % (- too near, + too far)")
    bias.set_title("Bias")
    return figure
