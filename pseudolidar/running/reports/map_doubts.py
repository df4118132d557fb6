"""How sure a path says that it is: against its true errors, and of the rig that it goes by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.plots.style import BLUE, GREEN, GREY, new_figure, zero_line
from pseudolidar.evaluation.page import Picture, PictureRow, Section
from pseudolidar.evaluation.trajectory.consistency import HIGH, LOW
from pseudolidar.evaluation.trajectory.plots import thinned
from pseudolidar.running.mapped.walked import Placed
from pseudolidar.running.reports.map_plots import mark_guessed
from pseudolidar.running.reports.map_report import MapReport
from pseudolidar.structures.arrays import Bool, Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ABOUT_DOUBT = (
    "Every pose comes with how unsure it is. Here its error against the source's own poses is "
    "measured in that: at 1 it is as large as was said, below 1 the path is better than it says, "
    "above 1 it is worse, or the source's own poses are. Of 100 honest ones 95 lie in the grey "
    "band. Steps are from one frame to the next; poses are seen from the first frame."
)
ABOUT_OFFSET = (
    "Cameras that have turned a little since they were calibrated see every disparity too large or "
    "too small by nearly the same amount, and far things too near or too far. What comes nearer "
    "while the rig drives tells how much. The line is what was known at each frame and taken off "
    "from then on, the band is its doubt (one standard deviation); the map is made with the last."
)


def doubt_sections(report: MapReport) -> list[Section]:
    """Errors in units of their doubt; none where the source does not know its poses."""
    told = report.consistency
    if told is None:
        return []
    figure, panels = new_figure(10.5, 3.4, ncols=2, sharey=True)
    guessed = ~report.pieces[0].measured
    drawn = ((told.steps, "steps", BLUE), (told.poses, "poses", GREEN))
    for axes, (values, name, colour) in zip(panels, drawn, strict=True):
        _nees(axes, values, colour, guessed)
        axes.set(title=f"Errors of {name} by their doubt", xlabel="frame of the path")
    panels[0].set_ylabel("squared, 1 is as said")
    plot = Picture.plot(figure, "normalised squared errors of steps and of poses")
    return [Section("Is it as sure as it says?", ABOUT_DOUBT, plots=[plot])]


def _nees(axes: Axes, values: Float64, colour: str, guessed: Bool) -> None:
    known = np.flatnonzero(values > 0)
    axes.axhspan(LOW, HIGH, color=GREY, alpha=0.2, linewidth=0)
    axes.axhline(1.0, color="black", linewidth=0.9)
    axes.set_yscale("log")
    if not len(known):
        return
    at = known[thinned(len(known))]
    median = float(np.median(values[known]))
    axes.plot(at, values[at], ".", color=colour, markersize=5, label=f"median {median:.2g}")
    chosen = known[guessed[known]]
    mark_guessed(axes, np.stack([chosen, values[chosen]], axis=1))
    axes.legend(fontsize=9, loc="lower right")


def offset_sections(placed: Sequence[Placed]) -> list[Section]:
    """How the rig's disparity offset was learned; none where it was not looked for."""
    known = [(n, *one.offset_px) for n, one in enumerate(placed) if one.offset_px is not None]
    if not known:
        return []
    numbers, offsets, sigmas = np.array(known, np.float64)[thinned(len(known))].T
    figure, axes = new_figure(10.5, 3.0)
    band = (offsets - sigmas, offsets + sigmas)
    axes.fill_between(numbers, *band, step="post", color=BLUE, alpha=0.15, linewidth=0)
    last = f"{offsets[-1]:+.2f} +- {sigmas[-1]:.2f} px at the end"
    axes.step(numbers, offsets, where="post", color=BLUE, linewidth=1.4, label=last)
    zero_line(axes)
    axes.set(xlabel="frame", ylabel="offset, px", title="Disparity offset of the rig")
    axes.legend(fontsize=9)
    plot = Picture.plot(figure, "the offset that was taken off, frame by frame")
    row = PictureRow((plot,))
    return [Section("What the motion told of the rig", ABOUT_OFFSET, pictures=[row])]
