"""What a comparison says in sentences and tables, for people who were not there."""

from __future__ import annotations

from collections.abc import Sequence

from pseudolidar.evaluation.comparison.bootstrap import Interval
from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.figures import DepthFigures, RangeFigures
from pseudolidar.evaluation.comparison.pooled import PooledFigures
from pseudolidar.evaluation.diagnosis.diagnosis import UNKNOWN, Diagnosis
from pseudolidar.evaluation.page import KeyFigure
from pseudolidar.running.reports.numbers import bare, between, counted, metres, percent
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

# Shares of errors within one sigma that are off by no more than this are called right.
SIGMA_TOLERANCE, SIGMA_TOLERANCE_OF_BIN = 0.05, 0.10
# A bias below this is none that matters.
SMALL_BIAS_REL = 0.002
ALTERNATIVES_SHOWN = 5

RANGE_HEADER = (
    "depth, m",
    "median error, %",
    "interval, %",
    "90 % below, %",
    "bias, %",
    "interval, %",
    "RMSE, m",
    "points",
)
COVERAGE_HEADER = (
    "depth, m",
    "coverage, %",
    "interval, %",
    "off by less than 1.05, %",
    "than 1.25, %",
    "reference points",
)
SIGMA_HEADER = (
    "depth, m",
    "within one sigma, %",
    "interval, %",
    "within the 95 % radius, %",
    "interval, %",
)


# What has figures of all points and of every bin.
Figures = Comparison | PooledFigures


def headline(compared: Figures, reference: str, frames: int) -> str:
    """The whole comparison in a sentence or two.

    Args:
        compared: its figures.
        reference: what stereo was compared with.
        frames: how many frames have a reference.
    """
    low, high = compared.bins.range_m
    overall, of_frames = compared.overall, counted(frames, "frame")
    if overall.median_rel is None or overall.p90_rel is None:
        return f"Between {low} and {high} m there is no point that can be compared, in {of_frames}."
    first = (
        f"Between {low} and {high} m, half of the stereo depths agree with the {reference}"
        f" to {percent(overall.median_rel)} of the distance and nine of ten to "
        f"{percent(overall.p90_rel)}, at {overall.n:,} points of {of_frames}."
    )
    return " ".join([first, *_extremes(compared.by_range)])


def _extremes(by_range: Sequence[RangeFigures]) -> list[str]:
    """Where it is best and where worst, if there is more than one range."""
    known = [(share, each) for each in by_range if (share := each.figures.median_rel) is not None]
    if len(known) < 2:
        return []
    (least, best), (most, worst) = (
        choose(known, key=lambda pair: pair[0]) for choose in (min, max)
    )
    return [
        f"The error is smallest at {best.from_m}-{best.to_m} m ({percent(least)}) and largest at "
        f"{worst.from_m}-{worst.to_m} m ({percent(most)}: "
        f"{metres(most * worst.from_m)} at {worst.from_m} m, "
        f"{metres(most * worst.to_m)} at {worst.to_m} m)."
    ]


def key_figures(compared: Figures) -> list[KeyFigure]:
    """The numbers that people ask for first."""
    overall = compared.overall
    bounds = overall.intervals
    keys = [
        KeyFigure("median error", percent(overall.median_rel), _surely(bounds.get("median_rel"))),
        KeyFigure("nine of ten within", percent(overall.p90_rel), _surely(bounds.get("p90_rel"))),
        KeyFigure("bias", percent(overall.bias_rel, signed=True), _bias_words(overall.bias_rel)),
        KeyFigure(
            "coverage", percent(overall.density, digits=1), "of the reference points have stereo"
        ),
    ]
    within = overall.within_1_sigma
    if within is not None:
        right = percent(ONE_SIGMA_SHARE, digits=0)
        note = f"{right} is right: {sigma_words(within, compared.by_range)}"
        keys.append(KeyFigure("within one sigma", percent(within, digits=1), note))
    return keys


def _surely(bounds: Interval | None) -> str:
    return (
        "no interval of a single frame"
        if bounds is None
        else f"{between(bounds)} % (95 % interval)"
    )


def _bias_words(bias: float | None) -> str:
    if bias is None:
        return ""
    if abs(bias) < SMALL_BIAS_REL:
        return "signed median: hardly any"
    return f"signed median: too {'far' if bias > 0 else 'near'}"


def sigma_words(within: float, by_range: Sequence[RangeFigures]) -> str:
    """Whether stated errors are honest, overall and at every range."""
    off = within - ONE_SIGMA_SHARE
    words = "stated errors are too small"
    if abs(off) <= SIGMA_TOLERANCE:
        words = "stated errors are honest"
    elif off > 0:
        words = "stated errors are larger than needed"
    small = [
        f"{each.from_m}-{each.to_m}"
        for each in by_range
        if (share := each.figures.within_1_sigma) is not None
        and share < ONE_SIGMA_SHARE - SIGMA_TOLERANCE_OF_BIN
    ]
    but = off >= -SIGMA_TOLERANCE and small
    return f"{words}, but too small at {', '.join(small)} m" if but else words


def range_table(compared: Figures) -> list[tuple[str, ...]]:
    """Errors of every bin, and of all of them, as cells of `RANGE_HEADER`."""
    return [
        (
            name,
            bare(figures.median_rel),
            between(figures.intervals.get("median_rel")),
            bare(figures.p90_rel),
            bare(figures.bias_rel, signed=True),
            between(figures.intervals.get("bias_rel"), signed=True),
            "-" if figures.rmse_m is None else f"{figures.rmse_m:.2f}",
            f"{figures.n:,}",
        )
        for name, figures in _bins(compared)
    ]


def coverage_table(compared: Figures) -> list[tuple[str, ...]]:
    """How many points there are and how many are right, as cells of `COVERAGE_HEADER`."""
    return [
        (
            name,
            bare(figures.density, digits=1),
            between(figures.intervals.get("density"), digits=1),
            bare(figures.delta_1_05, digits=1),
            bare(figures.delta_1_25, digits=1),
            f"{figures.reference:,}",
        )
        for name, figures in _bins(compared)
    ]


def sigma_table(compared: Figures) -> list[tuple[str, ...]]:
    """Shares of errors inside the stated bounds, as cells of `SIGMA_HEADER`."""
    return [
        (
            name,
            bare(figures.within_1_sigma, digits=1),
            between(figures.intervals.get("within_1_sigma"), digits=1),
            bare(figures.within_95, digits=1),
            between(figures.intervals.get("within_95"), digits=1),
        )
        for name, figures in _bins(compared)
    ]


def _bins(compared: Figures) -> list[tuple[str, DepthFigures]]:
    """Every bin with its name, then all of them."""
    rows = [(f"{each.from_m}-{each.to_m}", each.figures) for each in compared.by_range]
    low, high = compared.bins.range_m
    return [*rows, (f"all, {low}-{high}", compared.overall)]


def cause_header(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Heads of the table of causes: of a sum they are parts, and none of them is found."""
    what = "parts of a sum, none found alone" if diagnosis.chosen.effect.cancels else "what fits"
    return (what, "cause", "size", "looks the same as")


def cause_table(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """The chosen causes with their sizes, as cells of `cause_header`."""
    return [
        (
            sentence(found.text),
            plain(found.cause.name),
            f"{found.size:+.2g} ± {found.sigma:.1g} {found.cause.unit}",
            ", ".join(plain(name) for name in found.twins) or "-",
        )
        for found in diagnosis.chosen.causes
    ]


def diagnosis_words(diagnosis: Diagnosis) -> str:
    """What is wrong, in sentences."""
    size = f"The systematic disparity error is {diagnosis.systematic_px:.2f} px (median of blocks)"
    chosen = diagnosis.chosen
    if not chosen.causes:
        return f"{size}. The rig is healthy: no cause explains more than chance."
    share = percent(chosen.explained, digits=0)
    by = "a sum of those below" if chosen.effect.cancels else "the causes below"
    words = [
        f"{size}; {share} of it is explained by {by}, {diagnosis.unexplained_px:.2f} px are left."
    ]
    if chosen.effect.cancels:
        words.append(f"{sentence(chosen.effect.text)}: only the sum is sure, none of them alone.")
    if diagnosis.mostly_unknown:
        words.append(f"{sentence(UNKNOWN)}.")
    return " ".join([*words, _certainty(diagnosis)])


def _certainty(diagnosis: Diagnosis) -> str:
    others = len(diagnosis.alternatives)
    if not others:
        return "No other explanation with as few causes is as good on frames outside the fit."
    more = f"{counted(others, 'other explanation')} {'is' if others == 1 else 'are'}"
    return f"{more} as good on frames outside the fit: take none for certain."


def alternative_words(diagnosis: Diagnosis) -> list[str]:
    """Explanations that the data do not tell from the chosen one, the best first."""
    more = len(diagnosis.alternatives) - ALTERNATIVES_SHOWN
    named = [
        f"{sentence('; '.join(found.text for found in other.causes))} "
        f"(explains {percent(other.explained, digits=0)}{', as a sum' * other.effect.cancels})"
        for other in diagnosis.alternatives[:ALTERNATIVES_SHOWN]
    ]
    return [*named, f"And {more} more, in compare.json"] if more > 0 else named


def single_table(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """What each cause would explain alone."""
    return [
        (
            plain(one.names[0]),
            percent(one.explained, digits=0),
            sentence(one.causes[0].text),
        )
        for one in diagnosis.single
    ]


def sentence(words: str) -> str:
    """Words of a terminal as they are printed: a capital first, a plus-minus sign."""
    return (words[:1].upper() + words[1:]).replace("+-", "±")


def plain(name: str) -> str:
    """An identifier as words."""
    return name.replace("_", " ")
