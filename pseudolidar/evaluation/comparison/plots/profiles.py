"""Disparity error along the columns of the image and along disparity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREY,
    new_figure,
    nothing,
    zero_line,
)
from pseudolidar.evaluation.comparison.profiles import DisparityErrorBin

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def column_bias_plot(by_column: Sequence[DisparityErrorBin]) -> Figure:
    """Signed disparity error by image column; a flat line at 0 is right.

    Args:
        by_column: strips of the image.
    """
    figure, axes = _profile(by_column, [each.from_px for each in by_column])
    axes[0].set_title("Disparity error by image column")
    axes[1].set_xlabel("column of the left image, px")
    return figure


def disparity_bias_plot(by_disparity: Sequence[DisparityErrorBin]) -> Figure:
    """Signed disparity error by disparity; a flat line at 0 is right.

    Args:
        by_disparity: bands of disparity, which need not start above 0.
    """
    first = by_disparity[0]
    lows = [each.from_px for each in by_disparity]
    # a logarithmic axis has no 0: the first band is drawn as wide as an octave
    figure, axes = _profile(by_disparity, [first.from_px or first.to_px / 2, *lows[1:]])
    used = [each for each in by_disparity if each.n] or by_disparity
    edges = [each.from_px for each in used if each.from_px] + [used[-1].to_px]
    axes[1].set_xscale("log", base=2)
    axes[1].set_xticks(edges, [str(edge) for edge in edges], fontsize=9)
    axes[1].minorticks_off()
    axes[1].set_xlim((used[0].from_px or used[0].to_px / 2) * 0.95, used[-1].to_px * 1.05)
    axes[0].set_title("Disparity error by disparity")
    axes[1].set_xlabel("disparity of the reference, px (far at the left, near at the right)")
    return figure


def _profile(bins: Sequence[DisparityErrorBin], lows: Sequence[float]) -> tuple[Figure, Any]:
    figure, axes = new_figure(
        5.4, 3.9, nrows=2, sharex=True, gridspec_kw={"height_ratios": (3.4, 1)}
    )
    for low, each in zip(lows, bins, strict=True):
        if each.median_px is None or each.quartiles_px is None:
            continue
        middle = np.sqrt(max(low, 0.5) * each.to_px) if low < 0 else (low + each.to_px) / 2
        axes[0].fill_between([low, each.to_px], *each.quartiles_px, color=BLUE, alpha=0.22, lw=0)
        axes[0].plot([low, each.to_px], [each.median_px] * 2, color=BLUE, linewidth=2)
        axes[0].plot(middle, each.median_px, "o", color=BLUE, markersize=4)
        axes[1].bar(low, each.n / 1e3, each.to_px - low, align="edge", color=GREY, ec="white")
    if not any(each.n for each in bins):
        nothing(axes[0])
    zero_line(axes[0])
    axes[0].set_ylabel("error, px (+ is too near)")
    axes[1].set_ylabel("points, 10³")
    return figure, axes
