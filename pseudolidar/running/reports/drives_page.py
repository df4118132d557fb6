"""`report.html` of a comparison of many drives: all points together, and drive by drive."""

from __future__ import annotations

from pathlib import Path

from pseudolidar import __version__
from pseudolidar.errors import printable
from pseudolidar.evaluation.comparison.plots.by_range import range_error_plot
from pseudolidar.evaluation.comparison.plots.drives import drives_plot
from pseudolidar.evaluation.page import Picture, PictureRow, Section, render_page
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.reports.comparison_page import PAGE_PX
from pseudolidar.running.reports.comparison_words import (
    RANGE_HEADER,
    headline,
    key_figures,
    range_table,
)
from pseudolidar.running.reports.conversion_page import REPORT_NAME
from pseudolidar.running.reports.drives_report import DrivesReport
from pseudolidar.running.reports.numbers import counted


def write_drives_page(folder: Path, report: DrivesReport) -> Path:
    """Write `report.html` of all drives; each has one of its own in its folder.

    Args:
        folder: output folder.
        report: how it went.

    Returns:
        Path of the page.

    Raises:
        OutputError: the disk is full or gone.
    """
    path = folder / REPORT_NAME
    write_atomic(path, drives_page(report))
    return path


def drives_page(report: DrivesReport) -> bytes:
    """The bytes of the page.

    Args:
        report: how the comparison went.
    """
    every, drives = report.every, report.reports
    references = ", ".join(dict.fromkeys(each.comparison.reference for each in drives.values()))
    sections = [
        Section(
            "Error by range, all drives",
            table=range_table(every),
            header=RANGE_HEADER,
            pictures=[
                PictureRow(
                    (
                        Picture.plot(
                            range_error_plot(every.by_range),
                            "Relative depth error by range of the points of all drives. Whiskers "
                            "hold 95 % of resamples of the frames.",
                        ),
                    )
                )
            ],
        ),
        Section(
            "Drive by drive",
            "Median depth error by range of the reference. Each drive has a report.html of its own "
            "in its folder.",
            table=report.rows(),
            header=report.header,
            pictures=[
                PictureRow(
                    (
                        Picture.plot(
                            drives_plot({n: each.comparison.overall for n, each in drives.items()}),
                            "All points of each drive, the largest median on top.",
                        ),
                    )
                )
            ],
        ),
        *_left_out(report),
    ]
    return render_page(
        f"Stereo depth against {references}: {counted(len(drives), 'drive')}",
        f"pooled over the points of all frames; pseudolidar {__version__}",
        sections,
        lead=headline(every, references, every.frames),
        keys=key_figures(every),
        width_px=PAGE_PX,
    )


def _left_out(report: DrivesReport) -> list[Section]:
    rows = [(name, printable(str(error))) for name, error in report.failed.items()]
    skipped = ((name, len(each.result.skipped)) for name, each in report.reports.items())
    rows += [(name, f"{counted(count, 'frame')} skipped") for name, count in skipped if count]
    return [Section("Left out", table=rows)] if rows else []
