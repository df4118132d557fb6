"""The sections of a comparison's page that hold its figures: range, bias, sigma, causes."""

from __future__ import annotations

from collections.abc import Sequence

from pseudolidar.evaluation.comparison.bins import in_bin
from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.figures import RangeFigures
from pseudolidar.evaluation.comparison.plots.by_range import (
    coverage_plot,
    explained_bias_plot,
    inlier_plot,
    range_error_plot,
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
from pseudolidar.evaluation.diagnosis.diagnosis import Diagnosis
from pseudolidar.evaluation.page import Picture, PictureRow, Section
from pseudolidar.running.reports.comparison_words import (
    COVERAGE_HEADER,
    RANGE_HEADER,
    SIGMA_HEADER,
    alternative_words,
    cause_header,
    cause_table,
    coverage_table,
    diagnosis_words,
    range_table,
    sentence,
    sigma_table,
    single_table,
)
from pseudolidar.running.reports.numbers import percent


def by_range_sections(compared: Comparison) -> list[Section]:
    """Median, 90th percentile and bias of the depth error."""
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


def bias_sections(compared: Comparison) -> list[Section]:
    """Disparity error by disparity and by image column."""
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
    return [Section("Bias of the disparities", text, pictures=[row])]


def coverage_sections(compared: Comparison) -> list[Section]:
    """What share of the reference points stereo has, and has right."""
    coverage = Picture.plot(
        coverage_plot(compared.by_range),
        "Reference points without stereo count in no error.",
        alt=_spoken("Share of reference points with stereo", compared.by_range, "density"),
    )
    right = Picture.plot(
        inlier_plot(compared.by_range),
        "Points whose depth is right within a factor.",
        alt=_spoken("Depth off by less than 1.05", compared.by_range, "delta_1_05"),
    )
    return [
        Section(
            "Coverage and large errors",
            table=coverage_table(compared),
            header=COVERAGE_HEADER,
            pictures=[PictureRow((coverage, right))],
        )
    ]


def _explained(diagnosis: Diagnosis) -> Picture:
    parts = [
        f"{each.from_m}-{each.to_m} m {percent(each.bias_rel, signed=True)} and "
        f"{percent(each.explained_rel, signed=True)}"
        for each in diagnosis.bias
    ]
    caption = (
        "What the causes of the diagnosis make of the bias. Each block of the image counts the "
        "same here, so that figures differ from those of all points."
    )
    alt = f"Depth bias by range, measured and explained: {', '.join(parts)}"
    return Picture.plot(explained_bias_plot(diagnosis.bias), caption, alt=alt)


def _spoken_profile(what: str, bins: Sequence[DisparityErrorBin]) -> str:
    parts = [
        f"{each.from_px}-{each.to_px} px {each.median_px:+.2f} px"
        for each in bins
        if each.median_px is not None
    ]
    return f"{what}: {', '.join(parts) or 'no points'}"


def sigma_sections(compared: Comparison) -> list[Section]:
    """Whether stated errors are right."""
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
    within = (
        f"{percent(overall.within_1_sigma, digits=1)} within one sigma, "
        f"{percent(overall.within_95, digits=1)} within the 95 % radius"
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
                alt=f"Share of errors by their size in sigmas: {within}",
            ),
        ),
        (
            Picture.plot(
                reliability_plot(error, sigma),
                "Points in groups by their stated sigma; below the diagonal, sigma is too large.",
                alt="Error that 68 % stay below, for groups of points by their stated sigma",
            ),
            Picture.plot(
                sparsification_plot(curve),
                f"Whether sigma knows which points are bad{area}.",
                alt=f"Mean error left as the points of largest sigma are removed{area}",
            ),
        ),
    ]
    pictures = [PictureRow(row) for row in rows]
    table = sigma_table(compared)
    return [Section(title, text, table=table, header=SIGMA_HEADER, pictures=pictures)]


def diagnosis_sections(compared: Comparison) -> list[Section]:
    """Which causes explain the error, and which are not told apart."""
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
            header=cause_header(diagnosis),
            cells="words",
            pictures=[PictureRow((_explained(diagnosis),))],
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
