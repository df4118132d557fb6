"""A picture of a search: losses trial by trial, and which settings mattered."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREEN,
    GREY,
    VERMILLION,
    new_figure,
    nothing,
)
from pseudolidar.running.tuning.findings import Found
from pseudolidar.running.tuning.picture_mark import TITLE
from pseudolidar.running.tuning.search import Search

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN, HEIGHT_IN = 10.5, 4.4
# Losses beyond this, as a share of the first settings', are drawn at the border.
WORST = 1.5
# Candidates from which on it can be told what mattered.
LEAST_CANDIDATES = 12
# Room for the legend above what is drawn, share of the height.
LEGEND_SHARE = 0.3


def trials_png(search: Search, found: Found) -> bytes:
    """The picture as PNG."""
    figure, (left, right) = new_figure(WIDTH_IN, HEIGHT_IN, ncols=2, width_ratios=(3, 2))
    _draw_losses(left, search, found)
    _draw_ranks(right, search)
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Title": TITLE})
    return out.getvalue()


def _draw_losses(axes: Axes, search: Search, found: Found) -> None:
    on_all: list[tuple[int, float]] = []
    on_some: list[tuple[int, float]] = []
    every = search.frames.tuned_on
    for number, candidate in enumerate(search.tried.values()):
        seen = search.judged_on(candidate)
        if seen:
            score = min(search.score(candidate, seen), WORST)
            (on_all if len(seen) == len(every) else on_some).append((number, score))
    for points, colour, marker, words in (
        (on_some, GREY, ".", "left out after some frames"),
        (on_all, BLUE, "o", f"judged on all {len(every)} frames"),
    ):
        if points:
            axes.plot(*zip(*points, strict=True), marker, color=colour, markersize=5, label=words)
    lowest = np.minimum.accumulate([score for _, score in on_all])
    axes.step([n for n, _ in on_all], lowest, where="post", color=BLUE, label="best so far")
    axes.axhline(found.held, color=GREEN, linestyle="--", label="the best on frames held back")
    axes.axhline(1.0, color=VERMILLION, linewidth=1, label="first settings")
    axes.set(xlabel="settings tried", ylabel="loss as a share of the first settings'")
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + LEGEND_SHARE * (top - bottom))
    axes.set_title("Trials")
    axes.legend(fontsize=8, loc="upper right", ncols=2)


def _draw_ranks(axes: Axes, search: Search) -> None:
    first = search.frames.tuned_on
    candidates = [c for c in search.tried.values() if search.judged_on(c)]
    if len(candidates) < LEAST_CANDIDATES:
        nothing(axes, "too few trials to tell what mattered")
        return
    scores = [search.score(each, search.judged_on(each)) for each in candidates]
    places = np.array([search.space.place(each) for each in candidates])
    ranks = [_rank_correlation(column, scores) for column in places.T]
    order = np.argsort(np.abs(ranks))
    names = [search.space.names[i] for i in order]
    axes.barh(names, [ranks[i] for i in order], color=BLUE)
    axes.axvline(0, color=GREY, linewidth=0.8)
    axes.set(xlabel="rank correlation with the loss (left: more is better)", xlim=(-1, 1))
    axes.set_title(f"What mattered ({len(candidates)} settings, {len(first)} frames)")
    axes.tick_params(axis="y", labelsize=8)


def _rank_correlation(values: Sequence[float], scores: Sequence[float]) -> float:
    from scipy.stats import rankdata

    ranks = [rankdata(each) for each in (values, scores)]
    if min(float(np.ptp(each)) for each in ranks) == 0:
        return 0.0
    return float(np.asarray(np.corrcoef(ranks))[0, 1])
