"""`report.html` of `map`: the path, how far it is off, how it was found, the map in pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.plots.style import BLUE, GREEN, VERMILLION, new_figure
from pseudolidar.evaluation.page import KeyFigure, Picture, PictureRow, Section, render_page
from pseudolidar.evaluation.trajectory.plots import above_plot, along_plot, drift_plot, thinned
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.trajectory_file import KITTI_VERTICAL
from pseudolidar.running.mapped.walk import Piece, Placed
from pseudolidar.running.reports.conversion_page import REPORT_NAME, rig_rows
from pseudolidar.running.reports.loop_sections import loop_sections
from pseudolidar.running.reports.map_pictures import map_sections
from pseudolidar.running.reports.map_report import MapReport
from pseudolidar.running.reports.numbers import percent
from pseudolidar.running.reports.run_sections import notes_section, skips_section
from pseudolidar.sources.source import FrameSource
from pseudolidar.structures.cloud import PointCloud

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_map_page(
    report: MapReport,
    source: FrameSource,
    *,
    shown: PointCloud | None,
    settings: Mapping[str, str],
) -> MapReport:
    """Write the page.

    Args:
        report: what was made.
        source: the frames.
        shown: points of the map; None where there is none.
        settings: what was chosen, by name, for the reader.

    Returns:
        The report, with the page among its files.

    Raises:
        OutputError: the disk is full or gone.
        PseudolidarError: a picture cannot be read again.
    """
    result, rig = report.result, source.rig
    sections = [
        *map_sections(shown, report.pieces, rig),
        *loop_sections(report.walked, source),
        Section("The path", pictures=_paths(report)),
        *_drift(report),
        Section("How it was found", pictures=[PictureRow((_tracks(report.placed),))]),
        *_odd(report),
        *skips_section(result),
        *notes_section(result),
        Section("How it was made", table=[*rig_rows(rig), *settings.items()]),
    ]
    path = report.out / REPORT_NAME
    page = render_page(
        result.source.line,
        "where the cameras were, and what they saw",
        sections,
        keys=_keys(report),
    )
    write_atomic(path, page)
    return replace(report, files=(*report.files, path))


def _keys(report: MapReport) -> list[KeyFigure]:
    keys = [KeyFigure("frames", str(len(report.placed)), f"{len(report.lost)} lost")]
    if report.pieces:
        keys.append(KeyFigure("path", f"{report.pieces[0].length_m:.1f} m", "of the left camera"))
    if report.errors is not None:
        told = report.errors.summary()
        keys += [
            KeyFigure("end", percent(told["end_error_rel"]), "of the way, against the source"),
            KeyFigure("t_rel", percent(told["t_rel"]), "mean over segments"),
            KeyFigure("APE", f"{told['ape_rmse_m']:.3f} m", "rmse, aligned"),
        ]
    if "points" in report.map:
        keys.append(KeyFigure("map", f"{report.map['points']:,}", "points"))
    return keys


def _paths(report: MapReport) -> list[PictureRow]:
    if report.errors is not None:
        above = Picture.plot(
            above_plot(report.errors, None),
            "from above, beside the source's own poses; colours tell the position error",
            alt="The path from above beside the reference.",
        )
        along = Picture.plot(along_plot(report.errors), "errors along the path, aligned")
        return [PictureRow((above, along))]
    if not report.pieces:
        return []
    return [PictureRow((Picture.plot(_alone(report.pieces), "from above; each piece by itself"),))]


def _alone(pieces: Sequence[Piece]) -> Figure:
    """Paths across x and z of the camera: right and ahead."""
    figure, axes = new_figure(7.4, 6.2)
    across, ahead = (axis for axis in range(3) if axis != KITTI_VERTICAL)
    for number, piece in enumerate(pieces):
        places = piece.T_odom_camera[thinned(len(piece.frames))][:, (across, ahead), 3]
        axes.plot(*places.T, linewidth=1.6, label=f"piece {number + 1}")
        axes.plot(*places[0], "o", color="black", markersize=5)
    axes.set(xlabel="right, m", ylabel="ahead, m", title="From above")
    axes.set_aspect("equal", adjustable="datalim")
    if len(pieces) > 1:
        axes.legend(fontsize=9)
    return figure


def _drift(report: MapReport) -> list[Section]:
    if report.errors is None:
        return []
    plot = Picture.plot(drift_plot(report.errors.segments), "drift by length of segment")
    return [Section("Drift", plots=[plot])]


def _tracks(placed: Sequence[Placed]) -> Picture:
    figure, axes = new_figure(10.5, 3.2)
    numbers = np.arange(len(placed))
    axes.plot(numbers, [one.tracks for one in placed], color=BLUE, linewidth=1.2, label="tracks")
    inliers = [one.inliers for one in placed]
    axes.plot(numbers, inliers, color=GREEN, linewidth=1.2, label="that agree")
    for marked, name in (([one.lost for one in placed], "lost"), _caught(placed)):
        if any(marked):
            at = numbers[np.array(marked)]
            axes.plot(at, np.zeros(len(at)), "x", color=VERMILLION, label=name)
    axes.set(xlabel="frame", ylabel="points", title="Points that were followed")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=9)
    return Picture.plot(figure, "points followed from keyframes, and those that agree")


def _caught(placed: Sequence[Placed]) -> tuple[list[bool], str]:
    return [one.wrong for one in placed], "wrong step, caught"


def _odd(report: MapReport) -> list[Section]:
    rows = [(one.id, "lost", one.why) for one in report.lost]
    rows += [
        (one.id, "wrong step", "pictures or map disagree with vision; another step was taken")
        for one in report.corrected
    ]
    return [Section("Frames to look at", table=rows)] if rows else []
