"""`report.html` of a comparison: how wrong the metres are, where, why, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pseudolidar import __version__
from pseudolidar.evaluation.comparison.bootstrap import COVERED, RESAMPLES
from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.plots.frames import (
    birds_eye_plot,
    frames_plot,
    photo_error_plot,
    worst_frames,
)
from pseudolidar.evaluation.page import Picture, PictureRow, Section, render_page
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.reports.clouds_sections import clouds_section
from pseudolidar.running.reports.comparison_report import ComparisonReport
from pseudolidar.running.reports.comparison_sections import (
    bias_sections,
    by_range_sections,
    coverage_sections,
    diagnosis_sections,
    sigma_sections,
)
from pseudolidar.running.reports.comparison_verdict import verdict
from pseudolidar.running.reports.comparison_words import (
    headline,
    key_figures,
)
from pseudolidar.running.reports.conversion_page import REPORT_NAME, rig_rows
from pseudolidar.running.reports.left_out import left_out_words
from pseudolidar.running.reports.numbers import counted, percent
from pseudolidar.running.reports.samples import FrameSample, read_samples

# Frames shown with their photos, and from above.
PHOTOS, VIEWS = 6, 2
# Fits on a sheet of paper and on most screens.
PAGE_PX = 1120
SKIPS_SHOWN = 20


def write_comparison_page(
    folder: Path, report: ComparisonReport, *, settings: Mapping[str, str]
) -> Path:
    """Write `report.html`, self-contained, from a comparison and the samples of its run.

    Args:
        folder: output folder of the run.
        report: how it went.
        settings: what was chosen, by name, for the reader.

    Returns:
        Path of the page.

    Raises:
        OutputError: the disk is full or gone.
    """
    samples = read_samples(folder, report.result.committed)
    path = folder / REPORT_NAME
    write_atomic(path, comparison_page(report, samples=samples, settings=settings))
    return path


def comparison_page(
    report: ComparisonReport,
    *,
    samples: Mapping[str, FrameSample],
    settings: Mapping[str, str],
) -> bytes:
    """The bytes of the page.

    Args:
        report: how the comparison went.
        samples: photos of some frames, by id.
        settings: what was chosen, by name, for the reader.
    """
    compared = report.comparison
    name, _, _ = report.result.source.line.partition(":")
    sections = [
        Section("Verdict", points=verdict(compared)),
        Section("What was compared", table=_compared_rows(report, settings)),
        *by_range_sections(compared),
        *bias_sections(compared),
        *coverage_sections(compared),
        *_photos(compared, samples),
        *_views(compared, samples),
        *_clouds(compared),
        *sigma_sections(compared),
        *diagnosis_sections(compared),
        *_frames(compared),
        *_skips(report),
        _definitions(compared),
    ]
    return render_page(
        f"Stereo depth against {compared.reference}",
        f"{name}; compared at the same pixels of the left picture, pooled over the points of all "
        "frames",
        sections,
        lead=headline(compared, compared.reference, len(compared.per_frame)),
        keys=key_figures(compared),
        width_px=PAGE_PX,
    )


def _compared_rows(report: ComparisonReport, settings: Mapping[str, str]) -> list[tuple[str, str]]:
    compared, result = report.comparison, report.result
    frames = f"{len(compared.frames)} of {result.total} compared"
    frames = ", ".join([frames, *left_out_words(result, report.without_reference)])
    rows = [("source", result.source.line), ("reference", compared.reference), ("frames", frames)]
    rows += [*settings.items(), *rig_rows(compared.frames[0].rig)]
    rows += [("note", note) for note in report.notes]
    rows += [("warning", text) for text in result.warnings]
    return [*rows, ("made by", f"pseudolidar {__version__}")]


def _shown(compared: Comparison, samples: Mapping[str, FrameSample], most: int) -> list[int]:
    """Numbers of at most so many frames that have a photo, evenly spread."""
    known = [
        number
        for number, frame in enumerate(compared.frames)
        if frame.id in samples and samples[frame.id].photo.size
    ]
    places = np.linspace(0, len(known) - 1, min(most, len(known)))
    return [known[round(place)] for place in places]


def _caption(compared: Comparison, number: int) -> str:
    frame = compared.per_frame[number]
    return (
        f"Frame {frame.id}: median error {percent(frame.overall.median_rel)}, bias "
        f"{percent(frame.overall.bias_rel, signed=True)}, {counted(frame.overall.n, 'point')}"
    )


def _photos(compared: Comparison, samples: Mapping[str, FrameSample]) -> list[Section]:
    rows = []
    for number in _shown(compared, samples, PHOTOS):
        frame = compared.frames[number]
        caption = _caption(compared, number)
        picture = Picture.painted(
            photo_error_plot(samples[frame.id].photo, frame),
            caption,
            alt=f"Left picture with the depth error of each reference point. {caption}",
        )
        rows.append(PictureRow((picture,)))
    text = (
        "Every reference point in view on the left picture: white is right, blue too near, red too "
        "far; the scale ends at 10 %. Yellow points have no stereo."
    )
    return [Section("Errors over the picture", text, pictures=rows)] if rows else []


def _views(compared: Comparison, samples: Mapping[str, FrameSample]) -> list[Section]:
    rows = [
        PictureRow(
            (
                Picture.painted(
                    birds_eye_plot(compared.frames[number]),
                    _caption(compared, number),
                    alt=f"Both clouds of frame {compared.frames[number].id} from above",
                ),
            )
        )
        for number in _shown(compared, samples, VIEWS)
    ]
    text = (
        "Grey is the reference, colours are stereo at the same pixels: where both agree, colours "
        "lie on grey."
    )
    return [Section("Both clouds from above", text, pictures=rows)] if rows else []


def _clouds(compared: Comparison) -> list[Section]:
    title = "Cloud against cloud"
    return [] if compared.clouds is None else [clouds_section(compared.clouds, title=title)]


def _frames(compared: Comparison) -> list[Section]:
    if len(compared.per_frame) < 2:
        return []
    rows = [
        (
            frame.id,
            percent(frame.overall.median_rel),
            percent(frame.overall.p90_rel),
            percent(frame.overall.bias_rel, signed=True),
            percent(frame.overall.density, digits=1),
            f"{frame.overall.n:,}",
        )
        for frame in worst_frames(compared.per_frame)
    ]
    named = ", ".join(f"{row[0]} {row[1]}" for row in rows)
    plot = Picture.plot(
        frames_plot(compared.per_frame),
        "All frames; each is in compare.csv with its ranges.",
        alt=f"Median depth error of every frame; the worst are {named}",
    )
    return [
        Section(
            "Frame by frame",
            "The frames with the largest median errors:",
            table=rows,
            header=("frame", "median error", "90 % below", "bias", "coverage", "points"),
            pictures=[PictureRow((plot,))],
        )
    ]


def _skips(report: ComparisonReport) -> list[Section]:
    skipped = report.result.skipped
    rows = [
        (record.id, record.skipped["code"], record.skipped["got"])
        for record in skipped[:SKIPS_SHOWN]
        if record.skipped is not None
    ]
    more = len(skipped) - len(rows)
    text = "These frames are in no figure." + (f" {more} more are in compare.json." if more else "")
    return [Section("Skipped frames", text, table=rows)] if rows else []


def _definitions(compared: Comparison) -> Section:
    low, high = compared.bins.range_m
    return Section(
        "How to read this",
        table=[
            ("error", "stereo depth minus reference depth, relative to the reference depth"),
            ("median, 90 % below", "of its absolute value: half, nine of ten points err less"),
            ("bias", "median of the signed error: + stereo is too far, - too near"),
            ("RMSE", "root mean square error in metres, which few large errors dominate"),
            ("coverage", "share of the reference points in view that stereo has a point for"),
            ("within 1.05", "share of points whose depth is off by less than the factor 1.05"),
            ("sigma", "stated standard deviation of a disparity, systematic error of the rig in"),
            ("depth", f"distance along the optical axis, by the reference, {low}-{high} m here"),
            (
                "interval",
                f"holds {COVERED:.0%} of {RESAMPLES} resamples of the frames; neighbouring frames "
                "are alike, so that those of a short drive are rather too narrow",
            ),
        ],
    )
