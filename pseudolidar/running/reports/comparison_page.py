"""`report.html` of a comparison: how wrong the metres are, where, why, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pseudolidar import __version__
from pseudolidar.evaluation.comparison.bins import in_bin
from pseudolidar.evaluation.comparison.bootstrap import COVERED, RESAMPLES
from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.figures import RangeFigures
from pseudolidar.evaluation.comparison.plots.by_range import (
    coverage_plot,
    explained_bias_plot,
    range_error_plot,
)
from pseudolidar.evaluation.comparison.plots.frames import (
    birds_eye_plot,
    frames_plot,
    photo_error_plot,
    worst_frames,
)
from pseudolidar.evaluation.comparison.plots.profiles import column_bias_plot, disparity_bias_plot
from pseudolidar.evaluation.comparison.plots.sigma import (
    calibration_plot,
    reliability_plot,
    sigma_shares_plot,
    sparsification_plot,
)
from pseudolidar.evaluation.comparison.points import ComparedPoints
from pseudolidar.evaluation.comparison.profiles import DisparityErrorBin
from pseudolidar.evaluation.page import Picture, PictureRow, Section, render_page
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.reports.comparison_report import ComparisonReport, percent
from pseudolidar.running.reports.comparison_words import (
    CAUSE_HEADER,
    RANGE_HEADER,
    alternative_words,
    cause_table,
    counted,
    diagnosis_words,
    headline,
    key_figures,
    range_table,
    sentence,
    single_table,
)
from pseudolidar.running.reports.conversion_page import REPORT_NAME, rig_rows
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
    sections = [
        Section("What was compared", table=_compared_rows(report, settings)),
        *_by_range(compared),
        *_profiles(compared),
        *_photos(compared, samples),
        *_views(compared, samples),
        *_sigma(compared),
        *_diagnosis(compared),
        *_frames(compared),
        *_skips(report),
        _definitions(compared),
    ]
    return render_page(
        f"Stereo depth against {compared.reference}",
        "compared at the same pixels of the left picture, pooled over the points of all frames",
        sections,
        lead=headline(compared),
        keys=key_figures(compared),
        width_px=PAGE_PX,
    )


def _compared_rows(report: ComparisonReport, settings: Mapping[str, str]) -> list[tuple[str, str]]:
    compared, result = report.comparison, report.result
    frames = f"{len(compared.frames)} of {result.total} compared"
    left_out = [
        (report.without_reference, "without a reference"),
        (len(result.skipped), "skipped"),
    ]
    frames = ", ".join([frames, *(f"{count} {why}" for count, why in left_out if count)])
    rows = [("source", result.source.line), ("reference", compared.reference), ("frames", frames)]
    rows += [*settings.items(), *rig_rows(compared.frames[0].rig)]
    rows += [("note", note) for note in report.notes]
    rows += [("warning", text) for text in result.warnings]
    return [*rows, ("made by", f"pseudolidar {__version__}")]


def _by_range(compared: Comparison) -> list[Section]:
    plot = Picture.plot(
        range_error_plot(compared.by_range),
        "Relative depth error by range. Whiskers hold 95 % of resamples of the frames.",
        alt=_spoken("Median depth error by range", compared.by_range, "median_rel"),
    )
    return [
        Section(
            "Error by range",
            table=range_table(compared),
            header=RANGE_HEADER,
            pictures=[PictureRow((plot,))],
        )
    ]


def _spoken(what: str, by_range: Sequence[RangeFigures], name: str) -> str:
    parts = [
        f"{each.from_m}-{each.to_m} m {percent(getattr(each.figures, name))}" for each in by_range
    ]
    return f"{what}: {', '.join(parts)}"


def _profiles(compared: Comparison) -> list[Section]:
    row = PictureRow(
        (
            Picture.plot(
                disparity_bias_plot(compared.by_disparity),
                "Lines: median of a band; shaded: the middle half of its points.",
                alt=_spoken_profile("Median disparity error by disparity", compared.by_disparity),
            ),
            Picture.plot(
                column_bias_plot(compared.by_column),
                "The same by strips of the image, from its left border to its right one.",
                alt=_spoken_profile("Median disparity error by column", compared.by_column),
            ),
        )
    )
    text = (
        "A rig without systematic error has flat lines at zero. A line that is shifted as a whole "
        "is an offset of the disparities, one that rises with disparity a wrong baseline or focal "
        "length, one that bends over the columns turned cameras or lens distortion."
    )
    coverage = Picture.plot(
        coverage_plot(compared.by_range),
        "Reference points without stereo count in no error.",
        alt=_spoken("Share of reference points with stereo", compared.by_range, "density"),
    )
    rest = PictureRow((coverage, *_explained(compared)))
    return [Section("Bias and coverage", text, pictures=[row, rest])]


def _explained(compared: Comparison) -> list[Picture]:
    if compared.diagnosis is None:
        return []
    parts = [
        f"{each.from_m}-{each.to_m} m {percent(each.bias_rel, signed=True)} and "
        f"{percent(each.explained_rel, signed=True)}"
        for each in compared.diagnosis.bias
    ]
    caption = (
        "What the causes of the diagnosis make of the bias. Each block of the image counts the "
        "same here, so that figures differ from those of all points."
    )
    alt = f"Depth bias by range, measured and explained: {', '.join(parts)}"
    return [Picture.plot(explained_bias_plot(compared.diagnosis.bias), caption, alt=alt)]


def _spoken_profile(what: str, bins: Sequence[DisparityErrorBin]) -> str:
    parts = [
        f"{each.from_px}-{each.to_px} px {each.median_px:+.2f} px"
        for each in bins
        if each.median_px is not None
    ]
    return f"{what}: {', '.join(parts) or 'no points'}"


def _shown(compared: Comparison, samples: Mapping[str, FrameSample], most: int) -> list[int]:
    """Numbers of at most so many frames that have a photo, evenly spread."""
    known = [
        number
        for number, frame in enumerate(compared.frames)
        if frame.id in samples and samples[frame.id].photo.size
    ]
    places = np.linspace(0, len(known) - 1, min(most, len(known)))
    return [known[round(place)] for place in places]


def _photos(compared: Comparison, samples: Mapping[str, FrameSample]) -> list[Section]:
    rows = []
    for number in _shown(compared, samples, PHOTOS):
        frame, overall = compared.frames[number], compared.per_frame[number].overall
        caption = (
            f"Frame {frame.id}: median error {percent(overall.median_rel)}, bias "
            f"{percent(overall.bias_rel, signed=True)}, {counted(overall.n, 'point')}"
        )
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
                    f"Frame {compared.frames[number].id}",
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


def _sigma(compared: Comparison) -> list[Section]:
    title = "Are the stated errors right?"
    points = ComparedPoints.of(compared.frames)
    points = points[in_bin(points.reference_m, compared.bins.range_m) & points.matched]
    if points.sigma_px is None:
        return [Section(title, "These disparities come without a stated error (sigma).")]
    error, sigma = points.error_px, points.sigma_px
    overall = compared.overall
    text = (
        "Every point states its own error, sigma. Right means: 68 % of the true errors are smaller "
        "than sigma, 95 % smaller than its 95 % radius of 2.8 sigma. Here they are "
        f"{percent(overall.within_1_sigma, digits=1)} and {percent(overall.within_95, digits=1)}. "
        "Larger shares mean that stereo is better than it says."
    )
    curve = compared.sparsification
    area = "" if curve is None else f" (AUSE {curve.area:.2f}; 0 is perfect)"
    rows = [
        (
            Picture.plot(
                sigma_shares_plot(compared.by_range),
                "Dashed: what is right.",
                alt=_spoken("Errors within one sigma", compared.by_range, "within_1_sigma"),
            ),
            Picture.plot(
                calibration_plot(error, sigma),
                "The line should pass through both diamonds; above them, sigma is too large.",
            ),
        ),
        (
            Picture.plot(
                reliability_plot(error, sigma),
                "Points in groups by their stated sigma; below the diagonal, sigma is too large.",
            ),
            Picture.plot(
                sparsification_plot(curve),
                f"Whether sigma knows which points are bad{area}.",
            ),
        ),
    ]
    return [Section(title, text, pictures=[PictureRow(row) for row in rows])]


def _diagnosis(compared: Comparison) -> list[Section]:
    diagnosis, title = compared.diagnosis, "Diagnosis of the rig"
    timing = [] if compared.timing is None else [sentence(compared.timing.text)]
    if diagnosis is None:
        return [Section(title, "Too few points to tell causes apart.", points=timing)]
    sections = [
        Section(
            title,
            diagnosis_words(diagnosis),
            points=timing,
            table=cause_table(diagnosis),
            header=CAUSE_HEADER,
            cells="words",
        )
    ]
    if diagnosis.alternatives:
        text = "The data do not tell the diagnosis from these explanations, which are as good:"
        sections.append(Section("Not told apart", text, points=alternative_words(diagnosis)))
    text = "Share of the systematic error that one cause alone would explain, and its size then."
    header = ("cause", "explains", "as")
    sections.append(
        Section(
            "Each cause alone", text, table=single_table(diagnosis), header=header, cells="words"
        )
    )
    return sections


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
