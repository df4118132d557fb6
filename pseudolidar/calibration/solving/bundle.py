"""Bundle adjustment of cameras, the poses between them, and those of a board in every view.

Levenberg and Marquardt's steps on all unknowns at once; the poses of the board are eliminated by
the Schur complement, so that a step costs milliseconds. Weights for corners that disagree are found
anew after every few steps (iteratively reweighted least squares).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from pseudolidar.calibration.solving.lens_terms import INTRINSICS, Model, parameters, project
from pseudolidar.calibration.solving.observations import Observations
from pseudolidar.geometry.twists import exp_twists, skew
from pseudolidar.structures.arrays import Bool, Float64, Int64

POSE = 6
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e6
# A step that betters the sum of squares by less than this share ends the search; while weights are
# still to be found anew, sooner.
CONVERGED, NEARLY_CONVERGED = 1e-9, 1e-4
# Standard deviation of distortion coefficients before anything is seen, and that of a corner, px,
# which makes it a weight. It leaves coefficients alone that the corners tell and keeps those small
# that they do not (of the rational model, numerator and denominator can grow without end together).
PRIOR_COEFFICIENT, PRIOR_CORNER_PX = 2.0, 0.1
PRIOR = (PRIOR_CORNER_PX / PRIOR_COEFFICIENT) ** 2
# Points nearer than this are behind the lens or in it: such a step is not taken. Metres, and a
# share of the board's distance before would not change it.
NEAREST_M = 1e-6


@dataclass(frozen=True, eq=False)
class State:
    """What is solved for.

    Args:
        model: lens model of all eyes.
        cameras: for each eye its vector (n,), as `lens_terms` has it.
        T_eye_first: (E, 4, 4), the first eye's pose in each eye; the first is the identity.
        T_first_board: (V, 4, 4), the board's pose in the first eye, for each view.
    """

    model: Model
    cameras: tuple[Float64, ...]
    T_eye_first: Float64
    T_first_board: Float64

    def of_views(self, T_first_board: Float64) -> State:
        """The same cameras with other views."""
        return replace(self, T_first_board=T_first_board)


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of S unknowns that views share and of the poses of V views.

    Args:
        shared: (S, S) of what views share.
        between: (V, S, 6) between that and each pose.
        poses: (V, 6, 6) of the poses.
        shared_gradient: (S,) of half the sum of squares.
        pose_gradient: (V, 6) likewise.
    """

    shared: Float64
    between: Float64
    poses: Float64
    shared_gradient: Float64
    pose_gradient: Float64

    def reduced(self) -> Float64:
        """(S, S) information about what views share, the poses being free."""
        return np.asarray(
            self.shared
            - np.einsum("vsi,vij,vtj->st", self.between, np.linalg.inv(self.poses), self.between)
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """A solved bundle.

    Args:
        state: the solution.
        residuals: (V, E, N, 2) px, projected minus seen; 0 where not seen.
        weights: (V, E, N) of the corners, 0 where not seen.
        normal: normal equations there.
    """

    state: State
    residuals: Float64
    weights: Float64
    normal: Normal = field(repr=False)


Weighting = Callable[[Float64, Bool], Float64]


def equal_weights(residuals: Float64, seen: Bool) -> Float64:
    """Every corner counts alike."""
    del residuals
    return seen.astype(np.float64)


def adjust(
    seen: Observations,
    start: State,
    *,
    weighting: Weighting = equal_weights,
    rounds: int = 1,
    steps: int = 30,
    fixed: Bool | None = None,
) -> Fit:
    """Solve for what explains the corners best.

    Args:
        seen: the corners.
        start: where to begin.
        weighting: weights (V, E, N) of corners by their residuals.
        rounds: how often weights are found anew.
        steps: most steps in each round.
        fixed: (S,) which of the shared unknowns stay as they are: cameras, then poses of the eyes
            after the first.
    """
    state = start
    free = np.ones(_shared_size(start), np.bool_) if fixed is None else ~fixed
    for n in range(rounds):
        weights = weighting(_residuals(seen, state), seen.seen)
        enough = CONVERGED if n == rounds - 1 else NEARLY_CONVERGED
        state = _descend(seen, state, weights, free, steps, enough)
    residuals, normal = _linearised(seen, state, weights)
    return Fit(state, residuals, weights, normal)


def _shared_size(state: State) -> int:
    eyes = len(state.cameras)
    return eyes * parameters(state.model) + POSE * (eyes - 1)


def _descend(
    seen: Observations, state: State, weights: Float64, free: Bool, steps: int, enough: float
) -> State:
    damping = FIRST_DAMPING
    residuals, normal = _linearised(seen, state, weights)
    cost = _cost(residuals, weights) + _prior_cost(state)
    for _ in range(steps):
        trial = _moved(state, *_solved(normal, damping, free))
        possible = _in_front(seen, trial)
        trial_cost = np.inf
        if possible:
            trial_cost = _cost(_residuals(seen, trial), weights) + _prior_cost(trial)
        if not trial_cost < cost:
            damping *= 10
            if damping > MOST_DAMPING:
                break
            continue
        gain = cost - trial_cost
        state, cost, damping = trial, trial_cost, max(damping / 10, LEAST_DAMPING)
        if gain < enough * cost:
            break
        residuals, normal = _linearised(seen, state, weights)
    return state


def _cost(residuals: Float64, weights: Float64) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        return float((weights * (residuals**2).sum(axis=-1)).sum())


def _prior_cost(state: State) -> float:
    coefficients = np.concatenate([c[INTRINSICS:] for c in state.cameras])
    return PRIOR * float(coefficients @ coefficients)


def _in_front(seen: Observations, state: State) -> bool:
    """Whether the step left the cameras possible: focal lengths, and points a lens can see."""
    if any((camera[:2] <= 0).any() for camera in state.cameras):
        return False
    if state.model == "fisheye":
        return True
    return bool((_in_eyes(seen, state)[seen.seen][:, 2] > NEAREST_M).all())


def _in_eyes(seen: Observations, state: State) -> Float64:
    """(V, E, N, 3) corners in the frame of each eye."""
    T = np.einsum("eij,vjk->veik", state.T_eye_first, state.T_first_board)
    return np.asarray(seen.points_m @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3])


def _residuals(seen: Observations, state: State) -> Float64:
    """(V, E, N, 2) px, projected minus seen; 0 where not seen."""
    points = _in_eyes(seen, state)
    with np.errstate(all="ignore"):
        uv = np.stack(
            [project(state.model, c, points[:, e])[0] for e, c in enumerate(state.cameras)], axis=1
        )
    return np.where(seen.seen[..., None], uv - seen.uv, 0.0)


def _linearised(seen: Observations, state: State, weights: Float64) -> tuple[Float64, Normal]:
    """Residuals, and normal equations for small changes of everything."""
    views, size = len(seen), _shared_size(state)
    shared, between = np.zeros((size, size)), np.zeros((views, size, POSE))
    poses, gradient = np.zeros((views, POSE, POSE)), np.zeros(size)
    pose_gradient = np.zeros((views, POSE))
    residuals = np.zeros((*seen.seen.shape, 2))
    for part in _jacobians(seen, state, weights):
        residuals[:, part.eye] = part.residuals
        flat = part.by_shared.reshape(-1, len(part.columns))
        shared[np.ix_(part.columns, part.columns)] += flat.T @ flat
        gradient[part.columns] += flat.T @ part.weighted.ravel()
        coefficients = part.columns[INTRINSICS : parameters(state.model)]
        shared[coefficients, coefficients] += PRIOR
        gradient[coefficients] += PRIOR * state.cameras[part.eye][INTRINSICS:]
        by_view = np.swapaxes(part.by_view, 1, 2)
        between[:, part.columns] += np.swapaxes(part.by_shared, 1, 2) @ part.by_view
        poses += by_view @ part.by_view
        pose_gradient += (by_view @ part.weighted[..., None])[..., 0]
    return residuals, Normal(shared, between, poses, gradient, pose_gradient)


def steps_without(seen: Observations, fit: Fit) -> Float64:
    """(V, S) how what all share would change were a view not there, for each view."""
    size = _shared_size(fit.state)
    pulls, informed = np.zeros((len(seen), size)), np.zeros((len(seen), size, size))
    for part in _jacobians(seen, fit.state, fit.weights):
        by_shared = np.swapaxes(part.by_shared, 1, 2)
        pulls[:, part.columns] += (by_shared @ part.weighted[..., None])[..., 0]
        informed[:, part.columns[:, None], part.columns] += by_shared @ part.by_shared
    # The pose of each view's board is free.
    onto = fit.normal.between @ np.linalg.inv(fit.normal.poses)
    pulls -= np.einsum("vsi,vi->vs", onto, fit.normal.pose_gradient)
    informed -= np.einsum("vsi,vti->vst", onto, fit.normal.between)
    every = fit.normal.reduced()
    unit = 1.0 / np.sqrt(np.maximum(np.diag(every), 1e-12))
    without = (every - informed) * unit * unit[:, None]
    return np.stack(
        [
            unit * np.linalg.lstsq(rest, unit * pull, rcond=None)[0]
            for rest, pull in zip(without, pulls, strict=True)
        ]
    )


@dataclass(frozen=True, eq=False)
class _EyeJacobian:
    """What one eye's residuals say: (V, 2N) of them weighted, and how they change."""

    eye: int
    columns: Int64
    residuals: Float64
    weighted: Float64
    by_shared: Float64
    by_view: Float64


def _jacobians(seen: Observations, state: State, weights: Float64) -> Iterator[_EyeJacobian]:
    views, n = len(seen), parameters(state.model)
    points = _in_eyes(seen, state)
    for eye, camera in enumerate(state.cameras):
        part = seen.seen[:, eye]
        # Rows that nobody saw get a point that every lens can take, and no weight.
        at = np.where(part[..., None], points[:, eye], [0.0, 0.0, 1.0])
        uv, by_point, by_shared = project(state.model, camera, at)
        residuals = np.where(part[..., None], uv - seen.uv[:, eye], 0.0)
        R, t_m = state.T_eye_first[eye, :3, :3], state.T_eye_first[eye, :3, 3]
        by_first, in_first = by_point @ R, (at - t_m) @ R
        by_view = np.concatenate([by_first, -by_first @ skew(in_first)], axis=-1)
        columns = np.arange(eye * n, (eye + 1) * n)
        if eye:
            begin = len(state.cameras) * n + POSE * (eye - 1)
            columns = np.concatenate([columns, np.arange(begin, begin + POSE)])
            by_shared = np.concatenate([by_shared, by_point, -by_point @ skew(at)], axis=-1)
        root = np.sqrt(weights[:, eye])[..., None, None]
        yield _EyeJacobian(
            eye,
            columns,
            residuals,
            (residuals * root[..., 0]).reshape(views, -1),
            (by_shared * root).reshape(views, -1, len(columns)),
            (by_view * root).reshape(views, -1, POSE),
        )


def _solved(normal: Normal, damping: float, free: Bool) -> tuple[Float64, Float64]:
    """Steps of what is shared (S,) and of the poses (V, 6)."""
    poses = normal.poses + damping * _diagonals(normal.poses)
    shared = normal.shared + damping * _diagonals(normal.shared)
    inverse = np.linalg.inv(poses)
    onto = normal.between @ inverse
    reduced = shared - np.einsum("vsi,vti->st", onto, normal.between)
    right = -normal.shared_gradient + np.einsum("vsi,vi->s", onto, normal.pose_gradient)
    step = np.zeros(len(shared))
    # Focal lengths and coefficients differ by orders of magnitude.
    unit = 1.0 / np.sqrt(np.maximum(np.diag(reduced)[free], 1e-12))
    scaled = reduced[np.ix_(free, free)] * unit * unit[:, None]
    step[free] = unit * np.linalg.lstsq(scaled, unit * right[free], rcond=None)[0]
    back = -normal.pose_gradient - np.einsum("vsi,s->vi", normal.between, step)
    return step, np.einsum("vij,vj->vi", inverse, back)


def _diagonals(matrices: Float64) -> Float64:
    """Diagonals as diagonal matrices, nowhere 0."""
    diagonal = np.diagonal(matrices, axis1=-2, axis2=-1)
    return np.asarray(np.eye(matrices.shape[-1]) * np.maximum(diagonal, 1e-12)[..., None])


def _moved(state: State, shared: Float64, poses: Float64) -> State:
    n, eyes = parameters(state.model), len(state.cameras)
    cameras = tuple(c + shared[e * n : (e + 1) * n] for e, c in enumerate(state.cameras))
    T_eye_first = state.T_eye_first.copy()
    T_eye_first[1:] = exp_twists(shared[eyes * n :].reshape(-1, POSE)) @ T_eye_first[1:]
    moved = exp_twists(poses) @ state.T_first_board
    return State(state.model, cameras, T_eye_first, moved)
