"""Single frames: errors over the photo, both clouds from above, and which frames are worst."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.evaluation.comparison.comparison import FrameFigures
from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    ERROR_LIMIT,
    GREY,
    PERCENT,
    VERMILLION,
    error_scale,
    new_figure,
    nothing,
)
from pseudolidar.structures.arrays import Float64, UInt8

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection
    from matplotlib.figure import Figure

# The photo keeps so much of its brightness under the points, and is grey: colours are errors.
DIMMED = 0.42
WIDE_IN = 10.5
# Of wide figures the axes are so wide, beside the colour bar; titles and labels so high, inch.
DRAWN_SHARE, AROUND_IN = 0.83, 0.75
# Dots of reference points: at most so many, so large that they nearly touch (points squared).
MOST_DOTS = 40_000
DOT_AREA = 3.2
UNMATCHED = "#f2c400"
GROUND, LIDAR = "#18181c", "#8c8c94"
WORST_NAMED = 5
# Frames up to which each has a mark of its own.
MARKED_FRAMES = 80
# The view from above ends where all but this share of the reference points are nearer.
FARTHEST_QUANTILE, WIDEST_QUANTILE = 0.995, 0.99
MARGIN = 1.05


def photo_error_plot(photo: UInt8, compared: ComparedFrame) -> Figure:
    """Relative depth errors at the reference points, over the left picture.

    Blue is too near, white right, red too far; yellow are reference points without stereo.

    Args:
        photo: (h, w) or (h, w, 3) left picture of the frame, of any size.
        compared: the frame with its reference points.
    """
    width, height = compared.rig.left.size_px
    figure, axes = new_figure(WIDE_IN, WIDE_IN * DRAWN_SHARE * height / width + AROUND_IN)
    axes.grid(visible=False)
    grey = photo if photo.ndim == 2 else photo.mean(axis=2)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    axes.imshow(DIMMED * grey, cmap="gray", vmin=0, vmax=255, extent=extent)
    shown = compared.thinned(MOST_DOTS)
    bare = ~np.isfinite(shown.depth_m)
    axes.scatter(shown.u[bare], shown.v[bare], s=DOT_AREA / 2, c=UNMATCHED, lw=0, rasterized=True)
    errors = _percent_off(shown)[~bare]
    order = np.argsort(np.abs(errors))  # the worst on top
    dots = axes.scatter(
        shown.u[~bare][order],
        shown.v[~bare][order],
        c=errors[order],
        s=DOT_AREA,
        lw=0,
        rasterized=True,
        **error_scale(),
    )
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="column, px", ylabel="row, px")
    axes.set_title(f"Frame {compared.id}", loc="left")
    _colour_bar(figure, axes, dots)
    return figure


def _percent_off(compared: ComparedFrame) -> Float64:
    return np.asarray(PERCENT * (compared.depth_m / compared.reference_m - 1.0))


def _colour_bar(figure: Figure, axes: Axes, dots: PathCollection) -> None:
    bar = figure.colorbar(dots, ax=axes, extend="both", pad=0.01, fraction=0.03, aspect=14)
    bar.set_ticks([-ERROR_LIMIT, 0.0, ERROR_LIMIT])
    bar.set_label("depth error, %\n- near, + far")


def birds_eye_plot(compared: ComparedFrame) -> Figure:
    """Both clouds from above, at the points that both have: stereo by its error, reference grey.

    Args:
        compared: the frame with its reference points.
    """
    shown = compared.thinned(MOST_DOTS)
    K = shown.rig.left.K
    across = (shown.u - K[0, 2]) / K[0, 0]
    aside = -across * shown.reference_m
    ahead_m, right_m, left_m = _extent(shown.reference_m, aside)
    drawn_in = WIDE_IN * DRAWN_SHARE * (left_m - right_m) / ahead_m
    figure, axes = new_figure(WIDE_IN, drawn_in + AROUND_IN)
    axes.set_facecolor(GROUND)
    axes.grid(color="white", alpha=0.15)
    # ahead along x: a street is long, and a page is wide
    axes.scatter(shown.reference_m, aside, s=2.0, c=LIDAR, lw=0, rasterized=True)
    known = np.isfinite(shown.depth_m)
    dots = axes.scatter(
        shown.depth_m[known],
        -(across * shown.depth_m)[known],
        c=_percent_off(shown)[known],
        s=2.6,
        lw=0,
        rasterized=True,
        **error_scale(),
    )
    axes.set(
        xlim=(0, ahead_m),
        ylim=(right_m, left_m),
        aspect="equal",
        xlabel="ahead of the left camera (depth Z), m",
        ylabel="to the left (+) and right (-), m",
    )
    axes.set_title(f"Frame {compared.id} from above: stereo in colours, reference grey", loc="left")
    if not len(shown):
        nothing(axes)
    _colour_bar(figure, axes, dots)
    return figure


def _extent(ahead: Float64, aside: Float64) -> tuple[float, float, float]:
    """How far to draw ahead, to the right (negative) and to the left, m."""
    if not len(ahead):
        return 20.0, -5.0, 5.0
    ahead_m = MARGIN * float(np.quantile(ahead, FARTHEST_QUANTILE))
    right_m, left_m = np.quantile(aside[ahead < ahead_m], (1 - WIDEST_QUANTILE, WIDEST_QUANTILE))
    least_m = ahead_m / 10
    return ahead_m, MARGIN * min(right_m, -least_m), MARGIN * max(left_m, least_m)


def worst_frames(per_frame: Sequence[FrameFigures], most: int = WORST_NAMED) -> list[FrameFigures]:
    """The frames with the largest median errors, the worst first; those without points are none.

    Args:
        per_frame: figures of each frame.
        most: how many.
    """
    known = [frame for frame in per_frame if frame.overall.median_rel is not None]
    return sorted(known, key=lambda frame: -(frame.overall.median_rel or 0.0))[:most]


def frames_plot(per_frame: Sequence[FrameFigures]) -> Figure:
    """Median and 90th percentile of every frame, the worst ones named.

    Args:
        per_frame: figures of each frame.
    """
    figure, axes = new_figure(WIDE_IN, 3.2)
    known = [frame for frame in per_frame if frame.overall.median_rel is not None]
    few = len(known) <= MARKED_FRAMES
    index = [frame.index for frame in known]
    for name, colour, marker, label in (
        ("p90_rel", GREY, "s", "90th percentile"),
        ("median_rel", BLUE, "o", "median"),
    ):
        shares = [PERCENT * getattr(frame.overall, name) for frame in known]
        style = {"marker": marker if few else "", "markersize": 4.5, "linewidth": 1.0}
        axes.plot(index, shares, color=colour, label=label, **style)
    for rank, frame in enumerate(worst_frames(known, min(WORST_NAMED, max(1, len(known) // 3)))):
        at = frame.index, PERCENT * (frame.overall.median_rel or 0.0)
        axes.plot(*at, "D", color=VERMILLION, markersize=7, markerfacecolor="none")
        axes.annotate(
            frame.id,
            at,
            xytext=(0, 8 + 10 * (rank % 2)),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    if not known:
        nothing(axes)
    axes.set(xlabel="frame, position in the source", ylabel="relative depth error, %")
    axes.set_title("Error by frame; diamonds are the worst medians")
    axes.set_ylim(bottom=0)
    axes.xaxis.get_major_locator().set_params(integer=True)
    if known:
        axes.legend(frameon=False, fontsize=9)
    return figure
