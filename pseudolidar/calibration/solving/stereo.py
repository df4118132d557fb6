"""Two cameras and the pose between them, from what both see of a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.solving.bundle import Fit, State, adjust
from pseudolidar.calibration.solving.lens_terms import Model
from pseudolidar.calibration.solving.observations import Observations
from pseudolidar.calibration.solving.robust import Cauchy
from pseudolidar.calibration.solving.start import solve_eye
from pseudolidar.structures.arrays import Bool, Float64, Int64

# Views count half where they are off as much as is usual: on three real sets that halves what the
# baseline differs by between halves of the views, and lowers rows on held-out views by 2 to 20 %.
STEREO_WEIGHTS = Cauchy(view_ratio=1.0)
ROUNDS = 8
# Poses between the eyes that views give agree if their rotations differ by less.
AGREE_RAD = np.deg2rad(4.0)


@dataclass(frozen=True, eq=False)
class EyeFits:
    """Each camera calibrated alone.

    Args:
        left: over the views that it saw.
        right: the same.
        left_views: (n,) which views these are.
        right_views: the same.
    """

    left: Fit
    right: Fit
    left_views: Int64
    right_views: Int64


def solve_eyes(
    seen: Observations, model: Model, sizes_px: Sequence[tuple[int, int]], enough: Bool
) -> EyeFits:
    """Calibrate both cameras, each alone.

    Args:
        seen: V views of two eyes.
        model: of their lenses.
        sizes_px: (width, height) of each eye's pictures.
        enough: (V, 2) where an eye saw enough for a pose.
    """
    fits, views = [], []
    for eye in range(2):
        mine = np.flatnonzero(enough[:, eye])
        fits.append(solve_eye(seen.of_eye(eye).of_views(mine), model, sizes_px[eye]))
        views.append(mine)
    return EyeFits(fits[0], fits[1], views[0], views[1])


@dataclass(frozen=True, eq=False)
class Relation:
    """How the eyes stand to each other, as most views say, and how their boards were read.

    Args:
        T_right_left: (4, 4).
        ways: for each view of both eyes, which of the board's turns the right eye read.
        agreeing: share of those views whose eyes agree on the rotation.
    """

    T_right_left: Float64
    ways: tuple[int, ...]
    agreeing: float


def relate(T_left_board: Float64, T_right_board: Float64, board: Board) -> Relation:
    """Find the pose between the eyes that most views agree on.

    A board that looks alike from two sides may be read the other way round by one eye. Of the
    poses that follow from each way, the right ones agree over all views; the others are turned by
    half about the board's normal, which differs from view to view.

    Args:
        T_left_board: (V, 4, 4) poses of the board in the left eye, as it was read there.
        T_right_board: (V, 4, 4) the same in the right eye.
        board: which one.
    """
    turns = [_turn(board, ids) for ids in board.turns()]
    candidates = np.stack(
        [T_right_board @ turn @ np.linalg.inv(T_left_board) for turn in turns], axis=1
    )
    R = candidates[..., :3, :3]
    flat = R.reshape(-1, 3, 3)
    angles = _angles(np.einsum("aij,vwij->avw", flat, R))
    nearest = angles.min(axis=2)
    agree = (nearest < AGREE_RAD).sum(axis=1)
    # Of equals the one that turns the eyes least against each other, then the most central one.
    upright = _angles(np.trace(flat, axis1=1, axis2=2))
    order = np.lexsort((np.median(nearest, axis=1), upright > np.pi / 4, -agree))
    best = order[0]
    ways = angles[best].argmin(axis=1)
    chosen = candidates[np.arange(len(ways)), ways]
    near = nearest[best] < AGREE_RAD
    medoid = _medoid(chosen[near] if near.any() else chosen)
    return Relation(medoid, tuple(int(way) for way in ways), float(near.mean()))


def solve_pair(seen: Observations, state: State) -> Fit:
    """The joint fit of both eyes, from a state that is near."""
    return adjust(seen, state, weighting=STEREO_WEIGHTS, rounds=ROUNDS)


def _turn(board: Board, ids: Int64) -> Float64:
    """(4, 4) motion of the board's frame for which the corner called i lies where `ids[i]` does."""
    before, after = board.points_m, board.points_m[ids]
    middle, there = before.mean(axis=0), after.mean(axis=0)
    U, _, Vt = np.linalg.svd((after - there).T @ (before - middle))
    sign = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    T = np.eye(4)
    T[:3, :3] = U @ sign @ Vt
    T[:3, 3] = there - T[:3, :3] @ middle
    return np.asarray(np.linalg.inv(T))


def _angles(traces: Float64) -> Float64:
    return np.asarray(np.arccos(np.clip((traces - 1) / 2, -1.0, 1.0)))


def _medoid(poses: Float64) -> Float64:
    """The pose that is nearest to the others; translations count by the distance of the eyes."""
    R, t_m = poses[:, :3, :3], poses[:, :3, 3]
    turned = _angles(np.einsum("aij,bij->ab", R, R))
    length = max(float(np.median(np.linalg.norm(t_m, axis=1))), 1e-12)
    moved = np.linalg.norm(t_m[:, None] - t_m[None], axis=-1) / length
    return np.asarray(poses[np.argmin(np.median(turned + moved, axis=1))])
