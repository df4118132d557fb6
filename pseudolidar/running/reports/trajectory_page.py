"""The page of `evaluate trajectory`: paths from above, errors along them, drift, tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pseudolidar import __version__
from pseudolidar.evaluation.page import KeyFigure, Picture, PictureRow, Section, render_page
from pseudolidar.evaluation.trajectory.plots import above_plot, along_plot, drift_plot, plane_of
from pseudolidar.evaluation.trajectory.statistics import ErrorStatistics
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.reports.comparison_page import PAGE_PX
from pseudolidar.running.reports.numbers import counted, percent
from pseudolidar.running.reports.trajectory_report import TrajectoryReport, degrees

PAGE_BEGINS = b"<!doctype html"


def write_trajectory_page(path: Path, report: TrajectoryReport) -> TrajectoryReport:
    """Write the page; the report that names it.

    Raises:
        OutputError: it cannot be written.
    """
    write_atomic(path, trajectory_page(report))
    return replace(report, files=(*report.files, path))


def is_page(head: bytes) -> bool:
    """Whether a file begins as a page does."""
    return head.lstrip()[: len(PAGE_BEGINS)].lower() == PAGE_BEGINS


def trajectory_page(report: TrajectoryReport) -> bytes:
    """The bytes of the page.

    Args:
        report: the errors.
    """
    errors = report.errors
    known = report.reference.vertical
    flat = "xyz"[plane_of(errors.reference, known)[2]]
    why = "which stands upright" if known is not None else "along which they spread least"
    above = Picture.plot(
        above_plot(errors, known),
        f"both paths across {flat}, {why}",
        alt="The paths of estimate and reference from above; colours tell the position error.",
    )
    along = Picture.plot(
        along_plot(errors),
        f"{report.alignment_line}; by axis: estimate minus reference",
        alt="Position error, rotation error and its parts by axis along the path.",
    )
    drift = Picture.plot(
        drift_plot(errors.segments),
        "boxes hold half of the segments, their line is the median",
        alt="Drift of translation and rotation by length of the segment.",
    )
    return render_page(
        "Trajectory against reference",
        report.subject,
        [
            Section("Paths and errors", pictures=[PictureRow((above, along))]),
            Section("Drift over segments", text=report.drift_line, plots=[drift]),
            Section(
                "Drift by length",
                header=("length, m", "segments", "translation, %", "rotation, deg/m"),
                table=_drift_rows(report),
            ),
            Section(
                "Absolute and relative errors",
                text="Absolute: how far each pose is from where it should be. Relative: how far a "
                "motion between two poses is off, wherever it begins.",
                header=("", "n", "rmse", "mean", "median", "largest"),
                table=list(report.rows()),
            ),
            Section("What was compared", table=_facts(report)),
        ],
        lead=_lead(report),
        keys=_keys(report),
        width_px=PAGE_PX,
    )


def _lead(report: TrajectoryReport) -> str:
    return f"{report.pairing_line}; {report.alignment_line}."


def _keys(report: TrajectoryReport) -> list[KeyFigure]:
    errors, drift = report.errors, report.errors.segments
    position = ErrorStatistics.of(errors.ape_m)
    rotation = ErrorStatistics.of(np.degrees(errors.ape_rad))
    assert position is not None
    assert rotation is not None
    unsure = "; a turn about the path is open" if report.turn_is_open else ""
    keys = [
        KeyFigure("APE", f"{position.rmse:.3f} m", f"rmse; largest {position.max:.3f} m"),
        KeyFigure("rotation", f"{rotation.rmse:.3f} deg", f"rmse of poses{unsure}"),
        KeyFigure("t_rel", percent(drift.mean_t_rel), f"mean of {counted(len(drift), 'segment')}"),
        KeyFigure("r_rel", degrees(drift.mean_r_rel_deg_per_m), "deg/m, mean of segments"),
        KeyFigure("end", percent(errors.end_error_rel), "of the path, the whole motion"),
    ]
    if report.align == "sim3":
        keys.append(KeyFigure("scale", f"{errors.alignment.scale:.5f}", "of the estimate"))
    return keys


def _drift_rows(report: TrajectoryReport) -> list[tuple[str, ...]]:
    return [
        (
            f"{row.length_m:.0f}",
            str(row.n),
            percent(row.t_rel).removesuffix(" %"),
            degrees(row.r_rel_deg_per_m),
        )
        for row in report.errors.segments.by_length()
        if row.n
    ]


def _facts(report: TrajectoryReport) -> list[tuple[str, str]]:
    records = (("estimate", report.estimate), ("reference", report.reference))
    return [
        *((name, f"{one.path}: {len(one)} poses ({one.form})") for name, one in records),
        ("pairs", report.pairing_line),
        ("alignment", report.alignment_line),
        *(("note", note) for note in report.notes),
        ("made by", f"pseudolidar {__version__}"),
    ]
