"""`report.html` of a calibration: verdict, residuals, coverage, views, rectified pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar import __version__
from pseudolidar.calibration.solving.calibrated import Calibration
from pseudolidar.calibration.solving.choose import BETTER
from pseudolidar.calibration.solving.left_out import LeftOut
from pseudolidar.evaluation.page import KeyFigure, Picture, PictureRow, Section, render_page
from pseudolidar.geometry.grey import grey8_of
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import Rectification, rectification
from pseudolidar.geometry.rectified_pixels import eye_map
from pseudolidar.running.reports.calibration_plots import (
    coverage_plot,
    depth_plot,
    field_plot,
    marked_rows,
    residual_plot,
    rows_plot,
    views_plot,
)
from pseudolidar.structures.arrays import Float64, Image, UInt8

PAGE_PX = 1300
# Rectified pairs that are shown, and lines across each.
SHOWN_PAIRS, LINES = 3, 16
COEFFICIENTS = {
    "pinhole": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}


@dataclass(frozen=True, eq=False)
class ShownPair:
    """A pair of pictures that is shown rectified, eyes in their true order.

    Args:
        place: which of the views that tie the eyes together.
        left: the left picture.
        right: the right picture.
    """

    place: int
    left: Image
    right: Image


def calibration_page(
    calibration: Calibration, subject: str, left_out: Sequence[LeftOut], pairs: Sequence[ShownPair]
) -> bytes:
    """The bytes of the page.

    Args:
        calibration: the result.
        subject: what it was made from, one line.
        left_out: pairs that are not used, with the reason.
        pairs: some that are.
    """
    solution, verdict = calibration.solution, calibration.verdict
    plots = [residual_plot(calibration)]
    sections = [
        Section(
            "What it is worth",
            header=("", "value", "grade", "what would make it better"),
            table=[(j.name, j.value, j.grade, j.step) for j in verdict.judgements],
            cells="words",
        ),
        Section(
            "Rectified pairs",
            text="The same point lies on the same row of both pictures: the lines run through "
            "it twice. Corners of the board are green rings.",
            pictures=[PictureRow((_rectified(calibration, pair),)) for pair in pairs],
        ),
        Section("Rows and depths", plots=[rows_plot(calibration), depth_plot(calibration)]),
        Section("Views", plots=[views_plot(calibration)], header=("view", "reason", "off, px"),
                table=[(v.id, v.reason, _number(v.off_px)) for v in left_out], cells="words",
                text=f"{len(solution.paired)} views tie the eyes together; left out: "
                f"{len(left_out) or 'none'}.")
        if left_out
        else Section("Views", plots=[views_plot(calibration)],
                     text=f"{len(solution.paired)} views tie the eyes together; none is left out."),
        Section("Residuals", plots=[*plots, field_plot(calibration)]),
        Section("Coverage", plots=[coverage_plot(calibration)]),
        Section("Cameras", header=("", "left", "+-", "right", "+-"), table=_cameras(calibration)),
        Section("Right camera from the left one", header=("", "x", "y", "z"),
                table=_pose(calibration)),
        _models(calibration),
        Section("Made from", table=_made_from(calibration, subject)),
    ]  # fmt: skip
    return render_page(
        "Calibration of a stereo pair",
        subject,
        sections,
        lead=_lead(calibration),
        keys=_keys(calibration),
        width_px=PAGE_PX,
    )


def _lead(calibration: Calibration) -> str:
    verdict, solution = calibration.verdict, calibration.solution
    swapped = (
        " What was called left stands right: the eyes are exchanged back in the rig, so take these "
        "pictures with --swap."
        if solution.swapped
        else ""
    )
    steps = " ".join(verdict.steps)
    return f"This calibration is {verdict}.{' Next: ' + steps if steps else ''}{swapped}"


def _keys(calibration: Calibration) -> list[KeyFigure]:
    solution, sure = calibration.solution, calibration.sure
    left, right = solution.rms_px
    return [
        KeyFigure("model", solution.model, "predicts held-out views best"
                  if len(calibration.tried) > 1 else "as asked for"),
        KeyFigure("stereo rms", f"{solution.rms_stereo_px:.3f} px",
                  f"eyes alone {left:.3f} and {right:.3f} px"),
        KeyFigure("rows", f"{calibration.chosen.held_out.row_error_px:.3f} px",
                  "mean absolute, in views that were held out"),
        KeyFigure("baseline", f"{1000 * solution.baseline_m:.2f} mm",
                  f"+- {1000 * sure.baseline_m:.2f} mm, and as the square was measured"),
        KeyFigure("pairs", str(len(solution.paired)), "tie the eyes together"),
    ]  # fmt: skip


def _rectified(calibration: Calibration, pair: ShownPair) -> Picture:
    """Both eyes side by side, rectified, with lines."""
    rig, solution = calibration.rig, calibration.solution
    plan = rectification(rig)
    eyes = (rig.left, plan.R_left, pair.left), (rig.right, plan.R_right, pair.right)
    pictures = [_remapped(picture, plan, camera, R) for camera, R, picture in eyes]
    seen = solution.pairs.seen[pair.place]
    corners = [
        _on_picture(
            plan, Lens.of(camera).directions(solution.pairs.uv[pair.place, eye][part]) @ R.T
        )
        for eye, ((camera, R, _), part) in enumerate(zip(eyes, seen, strict=True))
    ]
    view = solution.views.ids[solution.paired[pair.place]]
    marked: UInt8 = marked_rows(pictures[0], pictures[1], (corners[0], corners[1]), LINES)
    return Picture.photo(marked, f"view {view}, left and right, rectified")


def _remapped(picture: Image, plan: Rectification, camera: Any, R: Float64) -> UInt8:
    import cv2

    places = eye_map(camera, R, plan.rig.left).uv
    grey = grey8_of(picture)
    return np.asarray(cv2.remap(grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR), np.uint8)


def _on_picture(plan: Rectification, directions: Float64) -> Float64:
    K = plan.rig.left.K
    ahead = directions[directions[:, 2] > 0]
    at = ahead[:, :2] / ahead[:, 2:] * [K[0, 0], K[1, 1]] + K[:2, 2]
    width, height = plan.rig.left.size_px
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    return np.asarray(at[inside])


def _cameras(calibration: Calibration) -> list[tuple[str, ...]]:
    rig, sure = calibration.rig, calibration.sure
    rows = []
    vectors = [
        np.array([c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2]]) for c in (rig.left, rig.right)
    ]
    for n, name in enumerate(("fx, px", "fy, px", "cx, px", "cy, px")):
        rows.append(
            (
                name,
                f"{vectors[0][n]:.3f}",
                f"{sure.left.intrinsics_px[n]:.3f}",
                f"{vectors[1][n]:.3f}",
                f"{sure.right.intrinsics_px[n]:.3f}",
            )
        )
    for n, name in enumerate(COEFFICIENTS[rig.left.model][: len(rig.left.distortion)]):
        rows.append(
            (
                name,
                f"{rig.left.distortion[n]:.6f}",
                f"{sure.left.distortion[n]:.6f}",
                f"{rig.right.distortion[n]:.6f}",
                f"{sure.right.distortion[n]:.6f}",
            )
        )
    sizes = [f"{c.width_px}x{c.height_px}" for c in (rig.left, rig.right)]
    return [*rows, ("size, px", sizes[0], "", sizes[1], "")]


def _pose(calibration: Calibration) -> list[tuple[str, ...]]:
    import cv2

    rig, sure = calibration.rig, calibration.sure
    turn = np.rad2deg(cv2.Rodrigues(rig.T_right_left.matrix[:3, :3])[0].ravel())
    turned = np.rad2deg(sure.rotation_rad)
    t_mm, moved = 1000 * rig.T_right_left.translation_m, 1000 * sure.translation_m
    return [
        ("translation, mm", *(f"{v:.3f} +- {s:.3f}" for v, s in zip(t_mm, moved, strict=True))),
        ("rotation vector, degrees",
         *(f"{v:.4f} +- {s:.4f}" for v, s in zip(turn, turned, strict=True))),
    ]  # fmt: skip


def _models(calibration: Calibration) -> Section:
    rows = [
        (
            candidate.solution.model + (" (taken)" if candidate is calibration.chosen else ""),
            f"{candidate.typical_px:.4f}",
            f"{candidate.solution.rms_stereo_px:.4f}",
            f"{candidate.held_out.row_error_px:.4f}",
            str(len(candidate.solution.paired)),
        )
        for candidate in calibration.tried
    ]
    return Section(
        "Lens models",
        text="A model with more freedom is taken only where it predicts views that were held out "
        f"{BETTER:.0%} better.",
        header=("model", "held-out views, px", "stereo rms, px", "rows, px", "pairs"),
        table=rows,
    )


def _made_from(calibration: Calibration, subject: str) -> list[tuple[str, str]]:
    solution = calibration.solution
    rows = [("pictures", subject), ("board", str(solution.views.board))]
    if solution.turned:
        rows.append(("read from the other end by one eye, put right", ", ".join(solution.turned)))
    return [*rows, ("made by", f"pseudolidar {__version__}")]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
