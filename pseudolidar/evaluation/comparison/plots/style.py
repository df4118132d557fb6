"""How every plot of a comparison looks: colours that everybody can tell apart, units on axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.evaluation.comparison.error_cloud import FULL_COLOUR_REL, RIGHT, TOO_FAR, TOO_NEAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure

    from pseudolidar.evaluation.comparison.bootstrap import Interval

# Source of the colours: Okabe & Ito, Color Universal Design, 2008: told apart by everybody. Markers
# and dashes differ as well.
BLUE, VERMILLION, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
PERCENT = 100.0
# Where the colours of errors end, percent.
ERROR_LIMIT = PERCENT * FULL_COLOUR_REL
# Dots per inch of what is not drawn as vectors.
DOTS_PER_INCH = 160
WIDTH_IN, HEIGHT_IN = 5.4, 3.3
# Above what is drawn, so that numbers have room; share of the height.
HEADROOM = 0.18


def new_figure(
    width_in: float = WIDTH_IN, height_in: float = HEIGHT_IN, **layout: Any
) -> tuple[Figure, Any]:
    """A figure with its axes, laid out without overlaps.

    Args:
        width_in: width, inch.
        height_in: height, inch.
        layout: of `Figure.subplots`.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.subplots(**layout)
    for each in np.atleast_1d(axes).flat:
        dress(each)
    return figure, axes


def dress(axes: Axes) -> None:
    """Thin lines behind the data, no box around them."""
    axes.grid(visible=True, alpha=0.3, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.title.set_fontsize(11)


def nothing(axes: Axes, words: str = "no points") -> None:
    """Say that there is nothing to be drawn."""
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color=GREY)


def with_intervals(
    axes: Axes,
    values: Sequence[float | None],
    bounds: Sequence[Interval | None],
    *,
    colour: str,
    marker: str,
    label: str = "",
    digits: int = 1,
    signed: bool = False,
    below: bool = False,
    numbers: bool = True,
) -> None:
    """Shares as percent at 0, 1, 2, ... with their intervals and numbers; None is left out.

    Args:
        axes: to draw on.
        values: shares, 0-1.
        bounds: interval of each; None without.
        colour: of all.
        marker: of the values.
        label: for the legend.
        digits: of the numbers, behind the point.
        signed: whether numbers have a sign; those of negative values stand below.
        below: whether all numbers stand below.
        numbers: whether values are written beside their marks.
    """
    known = [i for i, value in enumerate(values) if value is not None]
    if not known:
        nothing(axes)
        return
    at = PERCENT * np.array([values[i] for i in known], np.float64)
    ends = PERCENT * np.array([bounds[i] or (values[i],) * 2 for i in known], np.float64)
    reach = np.maximum(np.abs(ends.T - at), 0.0)
    axes.plot(known, at, color=colour, alpha=0.35, linewidth=1.2)
    axes.errorbar(
        known, at, yerr=reach, fmt=marker, color=colour, capsize=4, markersize=6, label=label
    )
    if not numbers:
        return
    for place, value, (low, high) in zip(known, at, ends, strict=True):
        under = below or (signed and value < 0)
        axes.annotate(
            f"{round(value, digits) + 0.0:{'+' if signed else ''}.{digits}f}",  # and no -0.0
            (place, min(low, value) if under else max(high, value)),
            xytext=(0, -5 if under else 5),
            textcoords="offset points",
            ha="center",
            va="top" if under else "bottom",
            fontsize=9,
            color=colour,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6},
        )


def depth_axis(axes: Axes, bins: Sequence[tuple[int, int]]) -> None:
    """Bins of the reference's depth along x, equally far apart."""
    axes.set_xticks(range(len(bins)), [f"{low}-{high}" for low, high in bins])
    axes.set_xlim(-0.5, len(bins) - 0.5)
    axes.set_xlabel("depth Z of the reference, m")


def headroom(axes: Axes, *, from_zero: bool = False) -> None:
    """Room above the data for numbers, and below where there is no zero line."""
    low, high = axes.get_ylim()
    room = HEADROOM * (high - low)
    axes.set_ylim(0.0 if from_zero else low - room, high + room)


def zero_line(axes: Axes) -> None:
    """Where there is no bias."""
    axes.axhline(0.0, color="black", linewidth=0.9)


def error_map() -> LinearSegmentedColormap:
    """Signed errors in the colours of error-coloured clouds: blue too near, red too far."""
    from matplotlib.colors import LinearSegmentedColormap

    ends = [tuple(level / 255 for level in colour) for colour in (TOO_NEAR, RIGHT, TOO_FAR)]
    return LinearSegmentedColormap.from_list("depth error", ends)


def error_scale() -> Mapping[str, Any]:
    """Arguments of `scatter` for relative errors in percent."""
    return {"cmap": error_map(), "vmin": -ERROR_LIMIT, "vmax": ERROR_LIMIT}
