"""Which lens model: the one that predicts views best that were held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.solving.bundle import State
from pseudolidar.calibration.solving.held_out import HeldOut, held_out, predicted
from pseudolidar.calibration.solving.lens_terms import Model
from pseudolidar.calibration.solving.solve import Solution, Views, solve
from pseudolidar.calibration.solving.start import poses_of
from pseudolidar.errors import BoardNotFound, CalibrationValue
from pseudolidar.structures.arrays import Float64

# In this order: the plainest that every tool reads, then the other lens, then one with more
# coefficients. A later one must predict better by this share to be taken.
TRIED: tuple[Model, ...] = ("pinhole", "fisheye", "pinhole8")
BETTER = 0.05


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model that was tried.

    Args:
        solution: with it.
        held_out: its errors in views that were held out.
        prediction_px: (V,) of every view of both eyes, those too that it left out; NaN elsewhere.
    """

    solution: Solution
    held_out: HeldOut
    prediction_px: Float64

    @property
    def typical_px(self) -> float:
        """Geometric mean over the views: it judges by ratios, whatever moves in some views."""
        known = self.prediction_px[np.isfinite(self.prediction_px)]
        return float(np.exp(np.mean(np.log(np.maximum(known, 1e-6)))))


def choose(
    views: Views, models: Sequence[Model] = TRIED, *, tried: Callable[[], None] = lambda: None
) -> tuple[Candidate, tuple[Candidate, ...]]:
    """Solve with each model and take the one that predicts best.

    Args:
        views: what was seen.
        models: which, the preferred first.
        tried: called after each.

    Returns:
        The chosen one, and all.

    Raises:
        BoardNotFound: too few views.
        CalibrationValue: no model leads to possible cameras.
    """
    candidates: list[Candidate] = []
    failure: CalibrationValue | BoardNotFound | None = None
    for model in models:
        try:
            candidates.append(candidate(views, model))
        except (CalibrationValue, BoardNotFound) as error:
            failure = failure or error
        tried()
    if not candidates:
        assert failure is not None
        raise failure
    best = candidates[0]
    for other in candidates[1:]:
        if other.typical_px < (1 - BETTER) * best.typical_px:
            best = other
    return best, tuple(candidates)


def candidate(views: Views, model: Model) -> Candidate:
    """Solve with a model and judge it by folds.

    Raises:
        BoardNotFound: too few views.
        CalibrationValue: it does not lead to possible cameras.
    """
    solution = solve(views, model)
    _ = solution.rig
    errors = held_out(solution)
    prediction = np.full(len(views.ids), np.nan)
    prediction[solution.paired] = errors.prediction_px
    seen = solution.views.seen
    others = np.setdiff1d(np.flatnonzero(seen.in_both), solution.paired)
    if len(others):
        state, shown = solution.fit.state, seen.of_views(others)
        first = poses_of(shown.of_eye(0), _first_eye(solution))
        prediction[others] = predicted(shown, state.of_views(first))
    return Candidate(solution, errors, prediction)


def _first_eye(solution: Solution) -> State:
    state = solution.fit.state
    return State(state.model, state.cameras[:1], state.T_eye_first[:1], state.T_first_board)
