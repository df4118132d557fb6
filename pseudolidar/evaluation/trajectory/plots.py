"""Figures of a judged trajectory: from above, errors along the path, drift by length."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREEN,
    GREY,
    PERCENT,
    VERMILLION,
    new_figure,
    nothing,
    zero_line,
)
from pseudolidar.evaluation.trajectory.judge import TrajectoryErrors
from pseudolidar.evaluation.trajectory.segments import Segments
from pseudolidar.structures.arrays import Float64, Int64

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AXES = "xyz"
UPRIGHT = 2  # where two axes are as likely: z
# Axes reach as far, m, deg or percent: digits of rounding are not drawn as errors.
LEAST_SHOWN = 1e-6
ERROR_COLOURS = "viridis"
# More vertices than this are not told apart, and make the page heavy.
MOST_DRAWN = 4000


def plane_of(T_world_body: Float64, vertical: int | None) -> tuple[int, int, int]:
    """The two axes that a path is drawn by, in the order of a map, and the third.

    Args:
        T_world_body: (N, 4, 4) the path.
        vertical: the third, where it is known; else that along which the path spreads least.
    """
    spread = np.ptp(T_world_body[:, :3, 3], axis=0)
    if vertical is None:
        vertical = UPRIGHT if spread[UPRIGHT] <= spread.min() else int(spread.argmin())
    across, ahead = (axis for axis in range(3) if axis != vertical)
    return across, ahead, vertical


def above_plot(errors: TrajectoryErrors, vertical: int | None) -> Figure:
    """Both paths from above, the estimate in the colour of its error.

    Args:
        errors: of the estimate.
        vertical: axis of the reference's world that stands upright, where it is known.
    """
    from matplotlib.collections import LineCollection

    figure, axes = new_figure(7.4, 6.2)
    across, ahead, _ = plane_of(errors.reference, vertical)
    kept = thinned(len(errors.path_m))
    true, own = (T[kept][:, (across, ahead), 3] for T in (errors.reference, errors.aligned))
    axes.plot(*true.T, color=GREY, linestyle=(0, (4, 2)), linewidth=1.2, label="reference")
    pieces = np.stack((own[:-1], own[1:]), axis=1)
    line = LineCollection(list(pieces), cmap=ERROR_COLOURS, linewidths=1.8, label="estimate")
    line.set_array(errors.ape_m[kept][1:])
    line.set_clim(0, max(float(errors.ape_m.max()), LEAST_SHOWN))
    axes.add_collection(line)
    axes.plot(*true[0], "o", color="black", markersize=7, label="start")
    axes.plot(*true[-1], "s", color=VERMILLION, markersize=6, label="end of the reference")
    axes.autoscale()
    axes.set(xlabel=f"{AXES[across]}, m", ylabel=f"{AXES[ahead]}, m", title="From above")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=9)
    figure.colorbar(line, ax=axes, label="position error, m", shrink=0.85)
    return figure


def along_plot(errors: TrajectoryErrors) -> Figure:
    """Position and rotation error, and its parts by axis, along the path."""
    figure, (off, turned, parts) = new_figure(7.4, 6.2, nrows=3, sharex=True)
    kept = thinned(len(errors.path_m))
    path_m = errors.path_m[kept]
    _filled(off, path_m, errors.ape_m[kept], BLUE)
    rmse = float(np.sqrt(np.mean(errors.ape_m**2)))
    off.axhline(rmse, color=VERMILLION, linewidth=1, linestyle="--", label=f"rmse {rmse:.3g} m")
    off.legend(fontsize=9, loc="upper left")
    off.set(title="Errors along the path", ylabel="position, m")
    _filled(turned, path_m, np.degrees(errors.ape_rad[kept]), GREEN)
    turned.set_ylabel("rotation, deg")
    difference = errors.aligned[kept, :3, 3] - errors.reference[kept, :3, 3]
    styles = zip(AXES, (BLUE, VERMILLION, GREEN), ("-", "--", "-."), strict=True)
    for axis, (name, colour, dashes) in enumerate(styles):
        parts.plot(path_m, difference[:, axis], dashes, color=colour, linewidth=1.2, label=name)
    zero_line(parts)
    low, high = parts.get_ylim()
    parts.set_ylim(min(low, -LEAST_SHOWN), max(high, LEAST_SHOWN))
    parts.set(xlabel="path of the reference, m", ylabel="by axis, m")
    parts.legend(fontsize=9, ncols=3, loc="upper left")
    return figure


def drift_plot(segments: Segments) -> Figure:
    """Every segment's drift, and the means, by length."""
    figure, panels = new_figure(10.5, 3.6, ncols=2)
    drawn = (
        (PERCENT * segments.t_rel, "translation, %", BLUE),
        (np.degrees(segments.r_rel_rad_per_m), "rotation, deg/m", GREEN),
    )
    for axes, (values, label, colour) in zip(panels, drawn, strict=True):
        axes.set(title=f"Drift by length: {label.partition(',')[0]}", ylabel=label)
        axes.set_xlabel("length of the segment, m")
        if not len(segments):
            nothing(axes, "no segment is as long")
            continue
        names = [f"{row.length_m:.0f}" for row in segments.by_length() if row.n]
        groups = [
            values[segments.length_m == row.length_m] for row in segments.by_length() if row.n
        ]
        axes.boxplot(
            groups,
            tick_labels=names,
            showfliers=False,
            widths=0.55,
            medianprops={"color": colour, "linewidth": 1.6},
            boxprops={"color": GREY},
            whiskerprops={"color": GREY},
            capprops={"color": GREY},
        )
        means = [float(group.mean()) for group in groups]
        places = range(1, len(groups) + 1)
        axes.plot(places, means, "D", color=VERMILLION, markersize=6, label="mean")
        axes.set_ylim(0, max(axes.get_ylim()[1], LEAST_SHOWN))
        axes.legend(fontsize=9)
    return figure


def thinned(n: int) -> Int64:
    """Indices of at most so many as are drawn, first and last among them."""
    if n <= MOST_DRAWN:
        return np.arange(n, dtype=np.int64)
    return np.unique(np.linspace(0, n - 1, MOST_DRAWN).round().astype(np.int64))


def _filled(axes: Axes, x: Float64, y: Float64, colour: str) -> None:
    axes.plot(x, y, color=colour, linewidth=1.2)
    axes.fill_between(x, y, color=colour, alpha=0.15, linewidth=0)
    axes.set_ylim(0, max(axes.get_ylim()[1], LEAST_SHOWN))
