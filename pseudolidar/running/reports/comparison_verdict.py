"""What a comparison comes to, in a few sentences."""

from __future__ import annotations

from pseudolidar.evaluation.comparison.comparison import Comparison
from pseudolidar.evaluation.comparison.figures import RangeFigures
from pseudolidar.evaluation.diagnosis.diagnosis import Diagnosis
from pseudolidar.running.reports.comparison_words import sentence, sigma_words
from pseudolidar.running.reports.numbers import between, counted, percent
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

# Errors of a range are of one sign where their median is at least this share of their size.
ONE_SIDED = 0.5


def verdict(compared: Comparison) -> list[str]:
    """Whether the rig or the matching is to blame, for what, and whether stated errors hold.

    Args:
        compared: the figures.
    """
    points = [_systematic(compared), *_rig(compared.diagnosis), *_stated(compared)]
    return [point for point in points if point]


def one_sided(by_range: tuple[RangeFigures, ...]) -> list[RangeFigures]:
    """Ranges most of whose error has one sign, surely: the interval of the bias leaves out zero."""
    found = []
    for each in by_range:
        figures, bounds = each.figures, each.figures.intervals.get("bias_rel")
        if figures.bias_rel is None or figures.median_rel is None:
            continue
        sure = bounds is None or bounds[0] * bounds[1] > 0
        if sure and abs(figures.bias_rel) >= ONE_SIDED * figures.median_rel:
            found.append(each)
    return found


def _systematic(compared: Comparison) -> str:
    if not compared.overall.n:
        return ""
    sided = one_sided(compared.by_range)
    if not sided:
        return (
            "The errors have both signs at every range: what is left comes from the matching, not "
            "from the rig."
        )
    worst = max(sided, key=lambda each: abs(each.figures.bias_rel or 0.0))
    bias, bounds = worst.figures.bias_rel or 0.0, worst.figures.intervals.get("bias_rel")
    surely = "" if bounds is None else f" ({between(bounds, signed=True)} %)"
    ranges = ", ".join(f"{each.from_m}-{each.to_m}" for each in sided)
    corrected = compared.frames[0].rig.correction is not None
    mend = (
        "although the rig has a correction, which more data would make better"
        if corrected
        else "and a correction can be fitted to it: pseudolidar refine SOURCE"
    )
    return (
        f"At {ranges} m most of the error has one sign. It is worst at {worst.from_m}-"
        f"{worst.to_m} m, where stereo is too {'far' if bias > 0 else 'near'} by "
        f"{percent(abs(bias))}{surely}. Such an error is one of the calibration, of the cameras or "
        f"of the scan's place, {mend}."
    )


def _rig(diagnosis: Diagnosis | None) -> list[str]:
    if diagnosis is None:
        return ["There are too few points to look for what is wrong with the rig."]
    size = f"The disparities are off by {diagnosis.systematic_px:.2f} px, typically"
    return [f"{size}. {cause_words(diagnosis)}."]


def cause_words(diagnosis: Diagnosis) -> str:
    """What fits the systematic error best, and how sure that is, in a sentence."""
    chosen = diagnosis.chosen
    if not chosen.causes:
        return "No cause in the rig explains more than chance"
    share = percent(chosen.explained, digits=0)
    if chosen.effect.cancels:
        shape = f", together {chosen.effect.shape}" if chosen.effect.shape else ""
        return (
            f"A sum of large causes that cancel each other fits best ({share}){shape}: none of "
            "them is found for itself"
        )
    causes = sentence("; ".join(found.text for found in chosen.causes))
    others = len(diagnosis.alternatives)
    sure = f"; {counted(others, 'other explanation')} fit as well" if others else ""
    rest = ", so most of it has another form" if diagnosis.mostly_unknown else ""
    return f"{causes}: that explains {share} of it{rest}{sure}"


def _stated(compared: Comparison) -> list[str]:
    within = compared.overall.within_1_sigma
    if within is None:
        return []
    right = percent(ONE_SIGMA_SHARE, digits=0)
    return [
        f"{percent(within, digits=1)} of the errors are within one stated sigma, where {right} is "
        f"right: {sigma_words(within, compared.by_range)}."
    ]
