"""How well a calibration predicts views that it has not seen: folds by view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.solving.bundle import State, adjust
from pseudolidar.calibration.solving.lens_terms import parameters
from pseudolidar.calibration.solving.observations import Observations
from pseudolidar.calibration.solving.solve import Solution, rig_of
from pseudolidar.calibration.solving.stereo import STEREO_WEIGHTS
from pseudolidar.errors import CalibrationValue
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import rectification
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig

FOLDS = 5
ROUNDS, STEPS = 3, 12


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors in views that a fit did not use.

    Args:
        rows_px: (P, N) row differences of rectified corners, left minus right; NaN where an eye
            does not see the corner, or it is outside of a rectified picture.
        prediction_px: (P,) reprojection error of each view with the cameras fixed, its board free.
    """

    rows_px: Float64
    prediction_px: Float64

    @property
    def row_error_px(self) -> float:
        """Mean absolute row difference."""
        known = np.isfinite(self.rows_px).any()
        return float(np.nanmean(np.abs(self.rows_px))) if known else np.inf


def held_out(solution: Solution, folds: int = FOLDS) -> HeldOut:
    """Solve again without every fifth view, and judge those that were held out.

    Args:
        solution: with all views; every fold begins there.
        folds: into how many parts the views go, by their order.
    """
    views, pairs = len(solution.paired), solution.pairs
    fold = np.arange(len(solution.blocks)) % folds
    fold[views:] = -1  # seen by one eye alone: they stay
    rows = np.full((views, pairs.seen.shape[-1]), np.nan)
    prediction = np.full(views, np.nan)
    for part in range(folds):
        without, mine = fold != part, np.flatnonzero(fold == part)
        if not len(mine):
            continue
        start = solution.fit.state.of_views(solution.fit.state.T_first_board[without])
        fit = adjust(
            solution.blocks.of_views(without),
            start,
            weighting=STEREO_WEIGHTS,
            rounds=ROUNDS,
            steps=STEPS,
        )
        judged = pairs.of_views(mine)
        poses = solution.fit.state.T_first_board[mine]
        prediction[mine] = predicted(judged, fit.state.of_views(poses))
        try:
            rows[mine] = row_differences(judged, rig_of(fit.state, solution.views.sizes_px))
        except CalibrationValue:
            rows[mine] = np.inf
    return HeldOut(rows, prediction)


def predicted(seen: Observations, state: State) -> Float64:
    """(V,) px, reprojection error of views whose board alone may move."""
    fixed: Bool = np.ones(2 * parameters(state.model) + 6, np.bool_)
    fit = adjust(seen, state, fixed=fixed, steps=STEPS)
    squares = (fit.residuals**2).sum(axis=(1, 2, 3))
    return np.asarray(np.sqrt(squares / np.maximum(seen.seen.sum(axis=(1, 2)), 1)))


def row_differences(seen: Observations, rig: StereoRig) -> Float64:
    """(V, N) rows of rectified corners, left minus right, px; NaN where one is not in a picture.

    Raises:
        CalibrationValue: the rig cannot be rectified.
    """
    plan = rectification(rig)
    K, picture = plan.rig.left.K, Lens.of(plan.rig.left)
    uv = []
    both = seen.seen.all(axis=1)
    for eye, (camera, R) in enumerate(((rig.left, plan.R_left), (rig.right, plan.R_right))):
        directions = Lens.of(camera).directions(seen.uv[:, eye]) @ R.T
        with np.errstate(all="ignore"):
            flat = directions[..., :2] / directions[..., 2:]
        at = flat * [K[0, 0], K[1, 1]] + K[:2, 2]
        with np.errstate(invalid="ignore"):
            both &= (directions[..., 2] > 0) & picture.inside(at)
        uv.append(at)
    return np.where(both, uv[0][..., 1] - uv[1][..., 1], np.nan)
