"""Whether stated sigmas are right: shares by range, calibration, sparsification."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.figures import RangeFigures
from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREEN,
    GREY,
    PERCENT,
    VERMILLION,
    depth_axis,
    new_figure,
    nothing,
    with_intervals,
)
from pseudolidar.evaluation.sigma import SparsificationCurve
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE, RADIUS_95_PER_SIGMA

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Groups of equally many points by their stated sigma.
GROUPS = 12
MOST_SIGMAS = 5.0


def sigma_shares_plot(by_range: Sequence[RangeFigures]) -> Figure:
    """Share of the errors within one sigma and within the 95 % radius, by range.

    Args:
        by_range: figures of every bin.
    """
    figure, axes = new_figure()
    for name, right, colour, marker, label in (
        ("within_95", 0.95, GREEN, "s", "within the 95 % radius (95 is right)"),
        ("within_1_sigma", ONE_SIGMA_SHARE, BLUE, "o", "within one sigma (68 is right)"),
    ):
        axes.axhline(PERCENT * right, color=colour, linestyle="--", linewidth=1)
        with_intervals(
            axes,
            [getattr(each.figures, name) for each in by_range],
            [each.figures.intervals.get(name) for each in by_range],
            colour=colour,
            marker=marker,
            label=label,
            digits=0,
            below=name == "within_1_sigma",
        )
    axes.set(title="Errors inside the stated bounds", ylabel="share of the points, %")
    axes.set_ylim(0, 112)
    axes.set_yticks(range(0, 101, 20))
    depth_axis(axes, [(each.from_m, each.to_m) for each in by_range])
    if any(each.figures.n for each in by_range):
        axes.legend(frameon=False, fontsize=9, loc="lower left")
    return figure


def calibration_plot(error_px: Float64, sigma_px: Float64) -> Figure:
    """Share of the errors within k sigma; the marks are what sigma promises.

    Args:
        error_px: (N,) signed or absolute errors.
        sigma_px: (N,) one standard deviation each.
    """
    figure, axes = new_figure()
    if len(error_px):
        k = np.linspace(0, MOST_SIGMAS, 101)
        ratio = np.sort(np.abs(error_px) / sigma_px)
        share = np.searchsorted(ratio, k, side="right") / len(ratio)
        axes.plot(k, PERCENT * share, color=BLUE, linewidth=2, label="found")
    else:
        nothing(axes)
    promised = ((1.0, ONE_SIGMA_SHARE), (RADIUS_95_PER_SIGMA, 0.95))
    for number, (radius, right) in enumerate(promised):
        label = "" if number else "promised"
        mark = {"color": VERMILLION, "markersize": 9, "linestyle": "", "label": label}
        axes.plot(radius, PERCENT * right, "D", **mark)
        axes.axvline(radius, color=VERMILLION, linestyle=":", linewidth=1)
    axes.set(
        title="Calibration of sigma",
        xlabel="error, in units of its stated sigma",
        ylabel="share of smaller errors, %",
        ylim=(0, 104),
        xlim=(0, MOST_SIGMAS),
    )
    axes.legend(frameon=False, fontsize=9, loc="lower right")
    return figure


def reliability_plot(error_px: Float64, sigma_px: Float64) -> Figure:
    """Found against stated sigma of points grouped by the stated one; the diagonal is right.

    Args:
        error_px: (N,) signed or absolute errors.
        sigma_px: (N,) one standard deviation each.
    """
    figure, axes = new_figure()
    if len(error_px):
        order = np.argsort(sigma_px, kind="stable")
        groups = [part for part in np.array_split(order, GROUPS) if len(part)]
        stated = np.array([np.median(sigma_px[part]) for part in groups])
        found = np.array([np.quantile(np.abs(error_px[part]), ONE_SIGMA_SHARE) for part in groups])
        ends = np.array([min(stated.min(), found.min()), max(stated.max(), found.max())])
        ends = np.maximum(ends * (0.8, 1.25), 1e-3)
        axes.plot(ends, ends, "--", color=GREY, label="stated is right")
        axes.plot(stated, np.maximum(found, 1e-3), "-o", color=BLUE, label="found")
        axes.set(xscale="log", yscale="log")
        for axis in (axes.xaxis, axes.yaxis):
            _plain_decades(axis)
        axes.legend(frameon=False, fontsize=9, loc="upper left")
    else:
        nothing(axes)
    axes.set(
        title="Found against stated sigma",
        xlabel="stated sigma of the disparity, px",
        ylabel="error that 68 % stay below, px",
    )
    return figure


def _plain_decades(axis: object) -> None:
    from matplotlib.axis import Axis
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

    assert isinstance(axis, Axis)
    axis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_formatter(NullFormatter())


def sparsification_plot(curve: SparsificationCurve | None) -> Figure:
    """Error that is left when the least sure points go first.

    Args:
        curve: None where there is no error to be sorted by.
    """
    figure, axes = new_figure()
    if curve is None:
        nothing(axes)
    else:
        gone = PERCENT * (1.0 - curve.kept)
        axes.axhline(PERCENT, color=GREY, linestyle=":", label="removed at random")
        axes.plot(gone, PERCENT * curve.by_sigma, color=BLUE, linewidth=2, label="by stated sigma")
        axes.plot(
            gone, PERCENT * curve.by_error, "--", color=VERMILLION, label="by true error (best)"
        )
        axes.legend(frameon=False, fontsize=9, loc="lower left")
    area = "" if curve is None else f" (AUSE {curve.area:.2f})"
    axes.set(
        title=f"Sparsification{area}",
        xlabel="points removed, %",
        ylabel="mean disparity error left, %",
        xlim=(0, 100),
        ylim=(0, 115),
    )
    return figure
