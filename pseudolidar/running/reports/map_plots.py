"""Plots of `map`'s report: the path from above, what was followed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.evaluation.comparison.plots.style import BLUE, GREEN, VERMILLION, new_figure
from pseudolidar.evaluation.page import Picture, PictureRow
from pseudolidar.evaluation.trajectory.judge import OPEN_TURN_DEG, TrajectoryErrors
from pseudolidar.evaluation.trajectory.plots import above_plot, along_plot, plane_of, thinned
from pseudolidar.formats.trajectory_file import KITTI_VERTICAL
from pseudolidar.running.mapped.walked import Piece, Placed
from pseudolidar.running.pose_reading import BODY_VERTICAL
from pseudolidar.running.reports.map_report import MapReport
from pseudolidar.structures.arrays import Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Poses that nothing was measured of, in every plot: hollow, so that what is beneath is seen.
GUESSED: Mapping[str, Any] = {
    "marker": "D",
    "markersize": 6,
    "markerfacecolor": "none",
    "markeredgecolor": "black",
}
EXTRAPOLATED = "extrapolated"


def path_plots(report: MapReport) -> list[PictureRow]:
    """The path from above, and its errors along it where the source knows its poses."""
    if not report.pieces:
        return []
    if report.errors is None:
        return [
            PictureRow((Picture.plot(_alone(report.pieces), "from above; each piece by itself"),))
        ]
    errors = report.errors
    above, along = above_plot(errors, BODY_VERTICAL), along_plot(errors)
    across, ahead, _ = plane_of(errors.reference, BODY_VERTICAL)
    guessed, errors_m = _laid_beside(errors, report.pieces[0])
    mark_guessed(above.axes[0], guessed[:, (across, ahead), 3])
    mark_guessed(along.axes[0], errors_m)
    told = "from above, beside the source's own poses; colours tell the position error"
    alt = "The path from above beside the reference."
    pictures = (
        Picture.plot(above, told, alt=alt),
        Picture.plot(along, f"errors along the path, aligned{_unsure(errors)}"),
    )
    return [PictureRow(pictures)]


def _unsure(errors: TrajectoryErrors) -> str:
    """That rotations mean little, where the path is nearly straight."""
    sigma_deg = errors.turn_sigma_deg
    if sigma_deg is not None and sigma_deg <= OPEN_TURN_DEG:
        return ""
    if sigma_deg is None:
        return ": positions leave the turn about a straight path open, and rotations mean little"
    return (
        f": positions hold the turn about a path that is nearly straight to {sigma_deg:.1f} deg, "
        "and rotations are no surer"
    )


def _laid_beside(errors: TrajectoryErrors, piece: Piece) -> tuple[Float64, Float64]:
    """Poses that were not measured, laid where the others are.

    Returns:
        (M, 4, 4); and (M, 2) their places along the path with how far they are off, m.
    """
    guessed, truth = ~piece.measured, piece.truth
    assert truth is not None  # there are errors
    laid = errors.alignment.poses(piece.T_odom_camera[guessed])
    along_m = np.interp(piece.times_ns[guessed], piece.times_ns[~guessed], errors.path_m)
    off_m = np.linalg.norm(laid[:, :3, 3] - truth[guessed][:, :3, 3], axis=1)
    return laid, np.stack([along_m, off_m], axis=1)


def _alone(pieces: Sequence[Piece]) -> Figure:
    """Paths across x and z of the camera: right and ahead."""
    figure, axes = new_figure(7.4, 6.2)
    across, ahead = (axis for axis in range(3) if axis != KITTI_VERTICAL)
    for number, piece in enumerate(pieces):
        places = piece.T_odom_camera[:, (across, ahead), 3]
        drawn = places[thinned(len(places))]
        axes.plot(*drawn.T, linewidth=1.6, label=f"piece {number + 1}")
        axes.plot(*places[0], "o", color="black", markersize=5)
        mark_guessed(axes, places[~piece.measured])
    axes.set(xlabel="right, m", ylabel="ahead, m", title="From above")
    axes.set_aspect("equal", adjustable="datalim")
    if len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(fontsize=9)
    return figure


def tracks_plot(placed: Sequence[Placed]) -> Picture:
    """Points that were followed in each frame, and the frames to look at."""
    figure, axes = new_figure(10.5, 3.2)
    numbers = np.arange(len(placed))
    axes.plot(numbers, [one.tracks for one in placed], color=BLUE, linewidth=1.2, label="tracks")
    inliers = [one.inliers for one in placed]
    axes.plot(numbers, inliers, color=GREEN, linewidth=1.2, label="that agree")
    guessed = numbers[np.array([one.extrapolated for one in placed], np.bool_)]
    mark_guessed(axes, np.stack([guessed, np.zeros(len(guessed))], axis=1))
    for marked, marker, colour, name in (
        ([one.lost for one in placed], "x", VERMILLION, "lost"),
        ([one.wrong for one in placed], "v", VERMILLION, "wrong step, caught"),
        ([one.blind for one in placed], "^", GREEN, "by its scan alone"),
    ):
        at = numbers[np.array(marked, np.bool_)]
        if len(at):
            axes.plot(at, np.zeros(len(at)), marker, color=colour, label=name, clip_on=False)
    axes.set(xlabel="frame", ylabel="points", title="Points that were followed")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=9)
    return Picture.plot(figure, "points followed from keyframes, and those that agree")


def mark_guessed(axes: Axes, places: Float64) -> None:
    """Mark places (N, 2) of poses that nothing was measured of, once in the legend."""
    if not len(places):
        return
    known = axes.get_legend_handles_labels()[1]
    label = "_" if EXTRAPOLATED in known else EXTRAPOLATED
    axes.plot(*places.T, linestyle="none", label=label, **GUESSED)
    axes.legend(fontsize=9)
