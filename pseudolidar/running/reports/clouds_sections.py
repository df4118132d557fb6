"""The part of a page that holds the distances between clouds."""

from __future__ import annotations

from pseudolidar.evaluation.comparison.clouds import F_RADII_M, CloudComparison, CloudFigures
from pseudolidar.evaluation.comparison.plots.clouds import distances_plot, scores_plot
from pseudolidar.evaluation.page import Picture, PictureRow, Section
from pseudolidar.running.reports.clouds_report import cloud_cells
from pseudolidar.running.reports.numbers import bare, bare_metres

CLOUDS_HEADER = (
    "range, m",
    "accuracy, m",
    "half within, m",
    "completeness, m",
    "half within, m",
    "chamfer, m",
    *(f"F at {radius:g} m, %" for radius in F_RADII_M),
    "points",
    "reference",
)


def clouds_section(compared: CloudComparison, *, title: str) -> Section:
    """Distances and F-scores by range, as a table and as plots.

    Args:
        compared: the figures.
        title: heading.
    """
    half, score = "accuracy_median_m", "f_score_0_2"
    spoken = [
        (name, each.figures[half], each.figures[score])
        for name, each in _bins(compared)[:-1]
        if each.figures[half] is not None
    ]
    plots = (
        Picture.plot(
            distances_plot(compared.by_range, compared.bins),
            "Accuracy: from our points to the reference. Completeness: from the reference to our "
            "points. Whiskers hold 95 % of resamples of the frames.",
            alt="Median distance of our points to the reference by range: "
            + (", ".join(f"{name} m {bare_metres(near)} m" for name, near, _ in spoken) or "none"),
        ),
        Picture.plot(
            scores_plot(compared.by_range, compared.bins),
            "Harmonic mean of the shares of points, of either cloud, that have a neighbour in the "
            "other one within the radius.",
            alt="F-score at 0.2 m by range: "
            + (", ".join(f"{name} m {bare(good)} %" for name, _, good in spoken) or "none"),
        ),
    )
    text = (
        "Distances from each point to the nearest one of the other cloud, in metres, in what both "
        "sensors see, by the range of the point. Accuracy is the mean distance of our points to "
        "the reference, completeness that of the reference's points to ours, chamfer the mean of "
        "both. A LiDAR has gaps between its beams, so that even a perfect cloud has an accuracy "
        "above zero."
    )
    rows = [_row(name, each) for name, each in _bins(compared)]
    return Section(title, text, table=rows, header=CLOUDS_HEADER, pictures=[PictureRow(plots)])


def _bins(compared: CloudComparison) -> list[tuple[str, CloudFigures]]:
    """Every bin with its name, then all of them."""
    names = [f"{low}-{high}" for low, high in compared.bins]
    low, high = compared.bins.range_m
    figures = (*compared.by_range, compared.overall)
    return list(zip((*names, f"all, {low}-{high}"), figures, strict=True))


def _row(name: str, each: CloudFigures) -> tuple[str, ...]:
    return (name, *cloud_cells(each), f"{each.n:,}", f"{each.reference:,}")
