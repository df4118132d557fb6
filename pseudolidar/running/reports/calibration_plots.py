"""Plots of a calibration: residuals, coverage, views, rows, depth errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pseudolidar.calibration.boards.coverage import CELLS
from pseudolidar.calibration.solving.calibrated import Calibration
from pseudolidar.calibration.solving.robust import spread
from pseudolidar.evaluation.comparison.plots.style import (
    BLUE,
    GREEN,
    GREY,
    VERMILLION,
    new_figure,
    nothing,
)
from pseudolidar.evaluation.page import Picture
from pseudolidar.structures.arrays import Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EYES, COLOURS = ("left", "right"), (BLUE, VERMILLION)
# Residuals are drawn longer than they are, so that the longest usual one has this share of the
# picture's width.
ARROW_SHARE = 0.05
# Residuals beyond this many standard deviations are drawn at the edge.
SHOWN_SIGMAS = 6.0
# Standard deviation of a good matcher's disparities, px: what the calibration's part is compared
# with.
MATCHER_PX = 0.25
PERCENT = 100.0


def residual_plot(calibration: Calibration) -> Picture:
    """Every residual as a point, both eyes."""
    solution = calibration.solution
    figure, axes = new_figure(8.0, 4.0, ncols=2, sharex=True, sharey=True)
    sigma = spread(solution.residuals, solution.pairs.seen)
    limit = SHOWN_SIGMAS * sigma
    for eye, (panel, colour) in enumerate(zip(axes, COLOURS, strict=True)):
        seen = solution.pairs.seen[:, eye]
        off = np.clip(solution.residuals[:, eye][seen], -limit, limit)
        panel.scatter(off[:, 0], off[:, 1], s=5, color=colour, alpha=0.35, linewidths=0)
        turn = np.linspace(0, 2 * np.pi, 100)
        panel.plot(3 * sigma * np.cos(turn), 3 * sigma * np.sin(turn), color=GREY, linewidth=1)
        panel.set_xlim(-limit, limit)
        panel.set_ylim(limit, -limit)  # down is down, as in the pictures
        panel.set_aspect("equal")
        panel.set_title(f"{EYES[eye]}: {seen.sum()} corners")
        panel.set_xlabel("x, px")
    axes[0].set_ylabel("y, px")
    caption = (
        "residuals, projected minus seen, of both eyes together; circle: 3 standard deviations"
    )
    return Picture.painted(figure, caption)


def field_plot(calibration: Calibration) -> Picture:
    """Where in the pictures residuals point where: what a lens model leaves shows as a pattern."""
    solution = calibration.solution
    figure, axes = new_figure(10.0, 4.2, ncols=2)
    usual = spread(solution.residuals, solution.pairs.seen)
    for eye, (panel, colour) in enumerate(zip(axes, COLOURS, strict=True)):
        seen = solution.pairs.seen[:, eye]
        uv, off = solution.pairs.uv[:, eye][seen], solution.residuals[:, eye][seen]
        width, height = solution.views.sizes_px[eye]
        factor = ARROW_SHARE * width / (3 * usual)
        panel.quiver(uv[:, 0], uv[:, 1], off[:, 0] * factor, off[:, 1] * factor, color=colour,
                     angles="xy", scale_units="xy", scale=1, width=0.0018, alpha=0.7)  # fmt: skip
        _as_picture(panel, width, height)
        panel.set_title(f"{EYES[eye]}: residuals, drawn {factor:.0f} times as long")
    return Picture.painted(figure, "residuals where they are in the pictures")


def coverage_plot(calibration: Calibration) -> Picture:
    """Where boards were seen in both pictures."""
    solution = calibration.solution
    figure, axes = new_figure(10.0, 4.2, ncols=2)
    for eye, (panel, cover) in enumerate(zip(axes, calibration.verdict.coverage, strict=True)):
        width, height = solution.views.sizes_px[eye]
        light = np.where(cover.counts > 0, np.log1p(cover.counts), np.nan)
        panel.imshow(light, extent=(-0.5, width - 0.5, height - 0.5, -0.5), cmap="Blues",
                     vmin=-0.8, vmax=np.log1p(200), aspect="auto")  # fmt: skip
        seen, uv = solution.blocks.seen[:, eye], solution.blocks.uv[:, eye]
        panel.scatter(*uv[seen].T, s=2, color="black", alpha=0.5, linewidths=0)
        for row, column in zip(*np.nonzero(cover.counts == 0), strict=True):
            x, y = (column + 0.5) * width / CELLS[0], (row + 0.5) * height / CELLS[1]
            panel.text(x, y, "-", color=VERMILLION, ha="center", va="center", fontsize=12)
        _as_picture(panel, width, height)
        panel.set_title(f"{EYES[eye]}: {cover.share:.0%} of the cells")
    return Picture.painted(figure, "corners of boards; cells without one have a red dash")


def views_plot(calibration: Calibration) -> Picture:
    """Errors of every view that ties the eyes together."""
    solution = calibration.solution
    squares, seen = (solution.residuals**2).sum(axis=-1), solution.pairs.seen
    errors = np.sqrt((squares * seen).sum(axis=2) / np.maximum(seen.sum(axis=2), 1))
    rows = calibration.chosen.held_out.rows_px
    known = np.isfinite(rows).any(axis=1)
    typical = np.full(len(rows), np.nan)
    typical[known] = np.nanmean(np.abs(np.where(np.isfinite(rows[known]), rows[known], np.nan)), 1)
    names = [solution.views.ids[view] for view in solution.paired]
    place = np.arange(len(names))
    figure, axes = new_figure(max(6.0, 0.32 * len(names) + 2.0), 3.6)
    for eye, colour in enumerate(COLOURS):
        axes.bar(place + (eye - 0.5) * 0.38, errors[:, eye], 0.36, color=colour, label=EYES[eye])
    axes.plot(place, typical, "D", color=GREEN, markersize=4, label="rows, view held out")
    axes.set_xticks(place, names, rotation=90, fontsize=7)
    axes.set_xlabel("view")
    axes.set_ylabel("error, px")
    axes.legend(fontsize=8, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    return Picture.plot(figure, "reprojection error of every view in both eyes, and its rows")


def rows_plot(calibration: Calibration) -> Picture:
    """Row differences of rectified corners in views that were held out."""
    rows = calibration.chosen.held_out.rows_px
    known = rows[np.isfinite(rows)]
    figure, axes = new_figure(5.4, 3.4)
    if len(known):
        limit = max(1.0, float(np.quantile(np.abs(known), 0.995)))
        axes.hist(np.clip(known, -limit, limit), bins=81, range=(-limit, limit), color=BLUE)
        mean = calibration.chosen.held_out.row_error_px
        axes.set_title(f"mean absolute {mean:.3f} px, {len(known)} corners")
    else:
        nothing(axes)
    axes.set_xlabel("row left - row right, px of the rectified pictures")
    axes.set_ylabel("corners")
    return Picture.plot(figure, "rows of held-out views")


def depth_plot(calibration: Calibration) -> Picture:
    """Depth error to expect by depth: of the calibration, and of a good matcher beside it."""
    table = calibration.sure.depth_m
    figure, axes = new_figure(5.4, 3.4)
    if len(table):
        fB = calibration.solution.fit.state.cameras[0][0] * calibration.solution.baseline_m
        axes.loglog(table[:, 0], PERCENT * table[:, 1] / table[:, 0], "o-", color=BLUE,
                    label="this calibration")  # fmt: skip
        axes.loglog(table[:, 0], PERCENT * table[:, 0] * MATCHER_PX / fB, "--", color=GREY,
                    label=f"matching, {MATCHER_PX:g} px")  # fmt: skip
        axes.legend(fontsize=8)
    else:
        nothing(axes)
    axes.set_xlabel("depth, m")
    axes.set_ylabel("standard deviation, % of the depth")
    return Picture.plot(figure, "depth error to expect over the picture")


def _as_picture(axes: Axes, width: int, height: int) -> None:
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.grid(visible=False)


def marked_rows(left: Any, right: Any, corners: tuple[Float64, Float64], lines: int) -> Any:
    """(H, 2W, 3) both pictures side by side, with lines along the rows and the corners on them."""
    import cv2

    pair = [np.repeat(eye[..., None], 3, axis=2) if eye.ndim == 2 else eye.copy()
            for eye in (left, right)]  # fmt: skip
    height = pair[0].shape[0]
    for eye, at in zip(pair, corners, strict=True):
        for x, y in at:
            cv2.circle(eye, (round(float(x)), round(float(y))), 3, (0, 158, 115), 1, cv2.LINE_AA)
    both = np.ascontiguousarray(np.concatenate(pair, axis=1))
    for row in np.linspace(0, height - 1, lines + 2)[1:-1].round().astype(int):
        cv2.line(both, (0, int(row)), (both.shape[1] - 1, int(row)), (213, 94, 0), 1)
    return both
