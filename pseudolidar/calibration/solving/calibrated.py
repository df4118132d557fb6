"""A calibrated pair with all that is known about how good it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from pseudolidar.calibration.solving.choose import TRIED, Candidate, choose
from pseudolidar.calibration.solving.lens_terms import Model
from pseudolidar.calibration.solving.solve import Solution, Views
from pseudolidar.calibration.solving.uncertainty import Uncertainty, uncertainty
from pseudolidar.calibration.solving.verdict import Verdict, judge
from pseudolidar.errors import CalibrationValue
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.quality import CalibrationQuality

ModelChoice = Literal["auto", "pinhole", "pinhole8", "thin-prism", "fisheye"]


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a set of views gives.

    Args:
        chosen: the model that was taken.
        tried: all that were.
        sure: standard deviations.
        verdict: what it is worth.
    """

    chosen: Candidate
    tried: tuple[Candidate, ...]
    sure: Uncertainty
    verdict: Verdict

    @property
    def solution(self) -> Solution:
        """The solved pair."""
        return self.chosen.solution

    @property
    def rig(self) -> StereoRig:
        """The rig, with its quality and where it comes from."""
        solution = self.solution
        views = solution.views
        swapped = ", eyes exchanged" if solution.swapped else ""
        used = len(solution.paired)
        return replace(
            solution.rig,
            origin=f"{solution.model} fitted to {views.board}, {used} views{swapped}",
            quality=self.quality,
        )

    @property
    def quality(self) -> CalibrationQuality:
        """Residuals and standard deviations, as a rig file has them."""
        solution, sure = self.solution, self.sure
        return CalibrationQuality(
            rms_left_px=solution.rms_px[0],
            rms_right_px=solution.rms_px[1],
            rms_stereo_px=solution.rms_stereo_px,
            holdout_row_error_px=self.chosen.held_out.row_error_px,
            views=len(solution.paired),
            left=sure.left,
            right=sure.right,
            rotation_sigma_rad=sure.rotation_rad,
            translation_sigma_m=sure.translation_m,
            baseline_sigma_m=sure.baseline_m,
            depth_sigma_m=sure.depth_m,
            nearest_m=solution.nearest_m,
        )


def calibrate(
    views: Views, model: ModelChoice = "auto", *, tried: Callable[[], None] = lambda: None
) -> Calibration:
    """Calibrate a pair of cameras.

    Args:
        views: what they saw of a board.
        model: of the lenses; `auto` for the one that predicts held-out views best.
        tried: called after each model.

    Raises:
        BoardNotFound: too few views.
        CalibrationValue: no possible cameras follow from them.
    """
    models: tuple[Model, ...] = TRIED if model == "auto" else (model,)
    try:
        chosen, every = choose(views, models, tried=tried)
        sure = uncertainty(chosen.solution)
    except CalibrationValue as error:
        raise _of_views(error) from error
    both = int(views.seen.in_both.sum())
    return Calibration(chosen, every, sure, judge(chosen, sure, views=both))


def _of_views(error: CalibrationValue) -> CalibrationValue:
    """What is wrong with views of a board, where the error speaks of a calibration's file."""
    found = ", ".join(part for part in (error.where, error.got) if part)
    return CalibrationValue(
        f"no possible cameras follow from these views: {found}",
        want=error.want,
        fix="Tilt the board by 30 degrees to all sides, hold it near and far, with both pictures "
        "of a pair of one moment. Check --board, and that left and right go together.",
    )
