"""`report.html` of `map`: the path, how far it is off, how it was found, the map in pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from pseudolidar.evaluation.page import KeyFigure, Picture, PictureRow, Section, render_page
from pseudolidar.evaluation.trajectory.plots import drift_plot
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.mapped.map_files import Made
from pseudolidar.running.reports.conversion_page import REPORT_NAME, rig_rows
from pseudolidar.running.reports.loop_sections import loop_sections
from pseudolidar.running.reports.map_doubts import doubt_sections, offset_sections
from pseudolidar.running.reports.map_grid import grid_sections
from pseudolidar.running.reports.map_pictures import map_sections
from pseudolidar.running.reports.map_plots import path_plots, tracks_plot
from pseudolidar.running.reports.map_report import MapReport
from pseudolidar.running.reports.numbers import percent
from pseudolidar.running.reports.run_sections import notes_section, skips_section
from pseudolidar.sources.source import FrameSource


def write_map_page(
    report: MapReport,
    source: FrameSource,
    made: Made,
    *,
    settings: Mapping[str, str],
) -> MapReport:
    """Write the page.

    Args:
        report: what was made.
        source: the frames.
        made: along the path: map and flat map, where there are some.
        settings: what was chosen, by name, for the reader.

    Returns:
        The report, with the page among its files.

    Raises:
        OutputError: the disk is full or gone.
        PseudolidarError: a picture cannot be read again.
    """
    result, rig = report.result, source.rig
    sections = [
        *map_sections(made.shown, report.pieces, rig),
        *grid_sections(made.grid, report.pieces, rig),
        *loop_sections(report.walked, source),
        Section("The path", pictures=path_plots(report)),
        *_drift(report),
        *doubt_sections(report),
        Section("How it was found", pictures=[PictureRow((tracks_plot(report.placed),))]),
        *offset_sections(report.placed),
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
    guessed = f", {len(report.extrapolated)} extrapolated" if report.extrapolated else ""
    keys = [KeyFigure("frames", str(len(report.placed)), f"{len(report.lost)} lost{guessed}")]
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


def _drift(report: MapReport) -> list[Section]:
    if report.errors is None:
        return []
    plot = Picture.plot(drift_plot(report.errors.segments), "drift by length of segment")
    return [Section("Drift", plots=[plot])]


def _odd(report: MapReport) -> list[Section]:
    rows = [
        (error.where, error.code, f"{error.got}; {error.want}") for error in report.walked.ended
    ]
    if report.odd_scans:
        rows.append(("scans", "LiDAR", report.odd_scans))
    rows += [(one.id, one.status, one.why) for one in report.placed if not one.measured]
    rows += [
        (one.id, "wrong step", "pictures or map disagree with vision; another step was taken")
        for one in report.corrected
    ]
    return [Section("Frames to look at", table=rows)] if rows else []
