"""`report.html` of a comparison of clouds with clouds: distances by range, F-scores."""

from __future__ import annotations

from pathlib import Path

from pseudolidar import __version__
from pseudolidar.evaluation.comparison.clouds import CloudComparison
from pseudolidar.evaluation.page import KeyFigure, Section, render_page
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.reports.clouds_report import CloudsReport
from pseudolidar.running.reports.clouds_sections import clouds_section
from pseudolidar.running.reports.comparison_page import PAGE_PX
from pseudolidar.running.reports.conversion_page import REPORT_NAME
from pseudolidar.running.reports.left_out import left_out_words
from pseudolidar.running.reports.numbers import counted, metres, percent


def write_clouds_page(folder: Path, report: CloudsReport) -> Path:
    """Write `report.html`.

    Args:
        folder: output folder.
        report: how it went.

    Returns:
        Path of the page.

    Raises:
        OutputError: the disk is full or gone.
    """
    path = folder / REPORT_NAME
    write_atomic(path, clouds_page(report))
    return path


def clouds_page(report: CloudsReport) -> bytes:
    """The bytes of the page.

    Args:
        report: how the comparison went.
    """
    compared = report.comparison
    left_out = left_out_words(report.result, report.without_reference)
    frames = [counted(compared.frames, "frame"), *left_out]
    sections = [
        Section(
            "What was compared",
            table=[
                ("clouds", compared.subject),
                ("reference", compared.reference),
                ("frames", ", ".join(frames)),
                *(("note", note) for note in report.notes),
                ("made by", f"pseudolidar {__version__}"),
            ],
        ),
        clouds_section(compared, title="Distances by range"),
    ]
    return render_page(
        "Clouds against clouds",
        "distances to nearest neighbours, pooled over the points of all frames",
        sections,
        lead=_lead(compared),
        keys=_keys(compared),
        width_px=PAGE_PX,
    )


def _lead(compared: CloudComparison) -> str:
    figures, (low, high) = compared.overall.figures, compared.bins.range_m
    half, most, back = (
        figures[name] for name in ("accuracy_median_m", "accuracy_p90_m", "completeness_median_m")
    )
    if half is None or most is None or back is None:
        return f"Between {low} and {high} m one of both clouds has no point."
    return (
        f"Between {low} and {high} m, half of our points lie within {metres(half)} of the "
        f"reference and nine of ten within {metres(most)}; half of the reference's points have one "
        f"of ours within {metres(back)}."
    )


def _keys(compared: CloudComparison) -> list[KeyFigure]:
    figures = compared.overall.figures
    lengths = [
        ("accuracy", "accuracy_m", "mean distance of our points to the reference"),
        ("completeness", "completeness_m", "mean distance of the reference to our points"),
        ("chamfer", "chamfer_m", "mean of both"),
    ]
    keys = [
        KeyFigure(name, "-" if (value := figures[key]) is None else metres(value), note)
        for name, key, note in lengths
    ]
    score = percent(figures["f_score_0_2"], digits=1)
    return [*keys, KeyFigure("F-score", score, "within 0.2 m")]
