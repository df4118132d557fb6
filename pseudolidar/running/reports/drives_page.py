"""`report.html` of a comparison of many drives: all points together, and drive by drive."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pseudolidar import __version__
from pseudolidar.errors import printable
from pseudolidar.evaluation.comparison.plots.by_range import range_error_plot
from pseudolidar.evaluation.comparison.plots.drives import drives_plot
from pseudolidar.evaluation.comparison.pooled import PooledFigures
from pseudolidar.evaluation.page import Picture, PictureRow, Section, link, render_page
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.reports.clouds_sections import clouds_section
from pseudolidar.running.reports.comparison_page import PAGE_PX
from pseudolidar.running.reports.comparison_report import ComparisonReport
from pseudolidar.running.reports.comparison_verdict import cause_words
from pseudolidar.running.reports.comparison_words import (
    RANGE_HEADER,
    headline,
    key_figures,
    range_table,
)
from pseudolidar.running.reports.conversion_page import REPORT_NAME
from pseudolidar.running.reports.drives_report import DrivesReport
from pseudolidar.running.reports.numbers import counted

if TYPE_CHECKING:
    from markupsafe import Markup


def write_drives_page(folder: Path, report: DrivesReport, *, settings: Mapping[str, str]) -> Path:
    """Write `report.html` of all drives; each has one of its own in its folder.

    Args:
        folder: output folder.
        report: how it went.
        settings: what was chosen, by name, for the reader.

    Returns:
        Path of the page.

    Raises:
        OutputError: the disk is full or gone.
    """
    path = folder / REPORT_NAME
    write_atomic(path, drives_page(report, settings=settings))
    return path


def drives_page(report: DrivesReport, *, settings: Mapping[str, str]) -> bytes:
    """The bytes of the page.

    Args:
        report: how the comparison went.
        settings: what was chosen, by name, for the reader.
    """
    every, drives = report.every, report.reports
    references = ", ".join(dict.fromkeys(each.comparison.reference for each in drives.values()))
    sections = [
        _by_range(every),
        _by_drive(report),
        _causes(report),
        *_clouds(every),
        *_left_out(report),
        Section(
            "What was compared",
            table=[
                *settings.items(),
                ("reference", references),
                ("drives", f"{len(drives)} compared, {len(report.failed)} left out"),
                ("frames", f"{every.frames}"),
                ("made by", f"pseudolidar {__version__}"),
            ],
        ),
    ]
    return render_page(
        f"Stereo depth against {references}: {counted(len(drives), 'drive')}",
        "compared at the same pixels of the left picture, pooled over the points of all frames",
        sections,
        lead=headline(every, references, every.frames),
        keys=key_figures(every),
        width_px=PAGE_PX,
    )


def _by_range(every: PooledFigures) -> Section:
    plot = Picture.plot(
        range_error_plot(every.by_range),
        "Relative depth error by range of the points of all drives. Whiskers hold 95 % of "
        "resamples of the frames.",
    )
    return Section(
        "Error by range, all drives",
        table=range_table(every),
        header=RANGE_HEADER,
        pictures=[PictureRow((plot,))],
    )


def _by_drive(report: DrivesReport) -> Section:
    plot = Picture.plot(
        drives_plot({name: each.comparison.overall for name, each in report.reports.items()}),
        "All points of each drive, the largest median on top.",
    )
    return Section(
        "Drive by drive",
        "Median depth error by range of the reference. Names lead to the report of the drive, in "
        "its folder.",
        table=_linked(report.rows()),
        header=report.header,
        pictures=[PictureRow((plot,))],
    )


def _causes(report: DrivesReport) -> Section:
    return Section(
        "What is wrong, drive by drive",
        table=[(_link(name), *_found(each)) for name, each in report.reports.items()],
        header=("drive", "systematic error", "what fits best"),
        cells="words",
    )


def _link(name: str) -> Markup:
    return link(name, f"{name}/{REPORT_NAME}")


def _linked(rows: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """The rows of drives with links; the last one is of all."""
    return [*((_link(row[0]), *row[1:]) for row in rows[:-1]), rows[-1]]


def _found(report: ComparisonReport) -> tuple[str, str]:
    """How large the systematic error of a drive is, and what explains it."""
    diagnosis = report.comparison.diagnosis
    if diagnosis is None:
        return "-", "too few points"
    return f"{diagnosis.systematic_px:.2f} px", cause_words(diagnosis)


def _clouds(every: PooledFigures) -> list[Section]:
    title = "Cloud against cloud, all drives"
    return [] if every.clouds is None else [clouds_section(every.clouds, title=title)]


def _left_out(report: DrivesReport) -> list[Section]:
    rows = [(name, printable(str(error))) for name, error in report.failed.items()]
    skipped = ((name, len(each.result.skipped)) for name, each in report.reports.items())
    rows += [(name, f"{counted(count, 'frame')} skipped") for name, count in skipped if count]
    return [Section("Left out", table=rows)] if rows else []
