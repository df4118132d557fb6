"""From corners in views to a solved pair of cameras; views that disagree are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.calibration.boards.board import Board
from pseudolidar.calibration.solving.bundle import Fit, State, adjust
from pseudolidar.calibration.solving.left_out import LeftOut, bad_corners, bad_views
from pseudolidar.calibration.solving.lens_terms import Model, camera_of
from pseudolidar.calibration.solving.observations import Observations
from pseudolidar.calibration.solving.robust import Cauchy, rms, view_spread
from pseudolidar.calibration.solving.stereo import EyeFits, relate, solve_eyes, solve_pair
from pseudolidar.errors import BoardNotFound
from pseudolidar.geometry.rectification import FISHEYE_FIELD_DEG, aligning_rotations
from pseudolidar.structures.arrays import Bool, Float64, Int64
from pseudolidar.structures.camera import LEFT_FRAME, RIGHT_FRAME, StereoRig
from pseudolidar.structures.pose import Pose

LEAST_VIEWS = 5
EYES = ("left", "right")
# Why views are left out.
BLURRED = (
    "its corners are badly found in the {eye} picture: blurred, or the board is bent or hidden"
)
APART = (
    "its eyes disagree: the board or the cameras moved between the two pictures; each eye is still "
    "used alone"
)
# How often views are judged anew after some were left out.
JUDGED = 3


@dataclass(frozen=True, eq=False)
class Views:
    """What two cameras saw of a board.

    Args:
        board: which one.
        ids: (V) names of the views.
        seen: V views of two eyes.
        sizes_px: (width, height) of each eye's pictures.
    """

    board: Board
    ids: tuple[str, ...]
    seen: Observations
    sizes_px: tuple[tuple[int, int], tuple[int, int]]

    def exchanged(self) -> Views:
        """With the eyes exchanged."""
        return replace(self, seen=self.seen.exchanged(), sizes_px=self.sizes_px[::-1])


@dataclass(frozen=True, eq=False)
class Solution:
    """A solved pair of cameras.

    The fit has blocks: first the views that tie both eyes together, then those that one eye alone
    saw, or whose eyes disagree, each for its eye alone.

    Args:
        views: what was seen, left and right in their true order, boards read the same way.
        fit: of all blocks.
        blocks: what each block saw.
        paired: (P,) which views the first P blocks are.
        left_out: views that do not tie the eyes together, with the reason.
        rms_px: of each eye calibrated alone.
        swapped: whether what was called left stands right.
        turned: ids of views whose board one eye had read the other way round.
        agreeing: share of views whose eyes agree on the rotation between them.
    """

    views: Views
    fit: Fit
    blocks: Observations
    paired: Int64
    left_out: tuple[LeftOut, ...]
    rms_px: tuple[float, float]
    swapped: bool
    turned: tuple[str, ...]
    agreeing: float

    @property
    def model(self) -> Model:
        """Lens model."""
        return self.fit.state.model

    @property
    def rms_stereo_px(self) -> float:
        """Reprojection error over the views that tie the eyes together, px."""
        return rms(self.residuals, self.pairs.seen)

    @property
    def pairs(self) -> Observations:
        """What the views that tie the eyes together saw, corners that are astray left out."""
        return self.blocks.of_views(np.arange(len(self.paired)))

    @property
    def residuals(self) -> Float64:
        """(P, 2, N, 2) px of those views, projected minus seen."""
        return self.fit.residuals[: len(self.paired)]

    @property
    def baseline_m(self) -> float:
        """Distance of the optical centres."""
        return float(np.linalg.norm(self.fit.state.T_eye_first[1, :3, 3]))

    @property
    def nearest_m(self) -> float | None:
        """Depth of the nearest corner that both eyes saw, in what the rectified pair shows."""
        R_left, _ = aligning_rotations(self.rig.T_right_left)
        T_first_board = self.fit.state.T_first_board[: len(self.paired)]
        turns, shifts = R_left @ T_first_board[:, :3, :3], T_first_board[:, :3, 3] @ R_left.T
        corners_m = self.pairs.points_m @ turns.transpose(0, 2, 1) + shifts[:, None]
        off_axis_m, depth_m = np.abs(corners_m[..., :2]).max(axis=-1), corners_m[..., 2]
        shown = off_axis_m < depth_m * np.tan(np.deg2rad(FISHEYE_FIELD_DEG / 2))
        found = depth_m[shown & self.pairs.seen.all(axis=1)]
        return float(found.min()) if len(found) else None

    @property
    def rig(self) -> StereoRig:
        """The cameras.

        Raises:
            CalibrationValue: the solution is none that cameras can have.
        """
        return rig_of(self.fit.state, self.views.sizes_px)


def rig_of(state: State, sizes_px: Sequence[tuple[int, int]]) -> StereoRig:
    """The rig of a state.

    Raises:
        CalibrationValue: no cameras can have these numbers.
    """
    left, right = (
        camera_of(state.model, vector, size_px, frame)
        for vector, size_px, frame in zip(
            state.cameras, sizes_px, (LEFT_FRAME, RIGHT_FRAME), strict=True
        )
    )
    return StereoRig(left, right, Pose(RIGHT_FRAME, LEFT_FRAME, state.T_eye_first[1]))


def solve(views: Views, model: Model) -> Solution:
    """Calibrate the pair with a lens model.

    Raises:
        BoardNotFound: too few views in which both eyes see the board.
    """
    enough = views.seen.enough
    check_enough(views, enough)
    eyes = solve_eyes(views.seen, model, views.sizes_px, enough)
    rms_px: list[float] = []
    blurred: dict[int, tuple[str, float]] = {}
    for eye, (fit, mine) in enumerate(
        ((eyes.left, eyes.left_views), (eyes.right, eyes.right_views))
    ):
        part = views.seen.of_eye(eye).of_views(mine)
        off = view_spread(fit.residuals, part.seen)
        bad = bad_views(off)
        enough[mine[bad], eye] = False
        blurred |= {int(v): (EYES[eye], float(o)) for v, o in zip(mine[bad], off[bad], strict=True)}
        good = part.of_views(~bad).without(bad_corners(_of_views(fit, ~bad), part.of_views(~bad)))
        state = fit.state.of_views(fit.state.T_first_board[~bad])
        rms_px.append(rms(adjust(good, state, weighting=Cauchy(), rounds=2).residuals, good.seen))
    check_enough(views, enough)
    return _judged(_related(views, eyes, enough, (rms_px[0], rms_px[1]), blurred))


def check_enough(views: Views, enough: Bool) -> None:
    """Raise `BoardNotFound` where both eyes see the board in too few views."""
    left, right = enough[:, 0], enough[:, 1]
    both = left & right
    if both.sum() >= LEAST_VIEWS:
        return
    raise BoardNotFound(
        f"both eyes see the {views.board.name} in {both.sum()} of {len(both)} views "
        f"(left {left.sum()}, right {right.sum()})",
        want=f"{LEAST_VIEWS} views or more, better 20",
        fix="Check --board: chessboards count inner corners, ChArUco boards squares. Take pictures "
        "in which both eyes see all of the board, sharp and lit evenly.",
    )


@dataclass(frozen=True, eq=False)
class _Related:
    """Eyes that are related to each other, in their true order, boards read the same way.

    Args:
        views: what was seen.
        state: both cameras and the pose between them, no views.
        enough: (V, 2) where an eye saw enough for a pose.
        poses: for each eye (V, 4, 4), the board's pose in it.
        rms_px: of each eye calibrated alone.
        blurred: views that one eye shows badly: which eye, and by how much it is off, px.
        swapped: whether the eyes were exchanged.
        turned: ids of views whose board one eye had read the other way round.
        agreeing: share of views whose eyes agree on the rotation between them.
    """

    views: Views
    state: State
    enough: Bool
    poses: tuple[Float64, Float64]
    rms_px: tuple[float, float]
    blurred: dict[int, tuple[str, float]]
    swapped: bool
    turned: tuple[str, ...]
    agreeing: float


def _related(
    views: Views,
    eyes: EyeFits,
    enough: Bool,
    rms_px: tuple[float, float],
    blurred: dict[int, tuple[str, float]],
) -> _Related:
    """Find the pose between the eyes, boards read the wrong way round, and exchanged eyes."""
    both, count = np.flatnonzero(enough.all(axis=1)), len(views.ids)
    left = _poses_of_all(count, eyes.left, eyes.left_views)
    right = _poses_of_all(count, eyes.right, eyes.right_views)
    relation = relate(left[both], right[both], views.board)
    turns = views.board.turns()
    ways: Int64 = np.zeros(count, np.int64)
    ways[both] = relation.ways
    views = replace(views, seen=views.seen.turned(1, [turns[way] for way in ways]))
    # A board that the right eye read another way stands as the left eye says.
    T_right_left = relation.T_right_left
    right[ways > 0] = T_right_left @ left[ways > 0]
    cameras = eyes.left.state.cameras[0], eyes.right.state.cameras[0]
    poses = left, right
    swapped = bool(T_right_left[0, 3] > 0)
    if swapped:
        views, enough, T_right_left = views.exchanged(), enough[:, ::-1], _inverse(T_right_left)
        poses, cameras, rms_px = poses[::-1], cameras[::-1], rms_px[::-1]
    pair = np.stack([np.eye(4), T_right_left])
    state = State(eyes.left.state.model, cameras, pair, np.zeros((0, 4, 4)))
    turned = tuple(views.ids[view] for view in np.flatnonzero(ways))
    return _Related(
        views, state, enough, poses, rms_px, blurred, swapped, turned, relation.agreeing
    )


def _judged(start: _Related) -> Solution:
    """The joint fit, with views left out until the rest agree."""
    views, state, seen = start.views, start.state, start.views.seen
    enough = start.enough
    tied: Bool = np.asarray(enough.all(axis=1), np.bool_)
    disagreeing: dict[int, float] = {}
    for _ in range(JUDGED):
        paired, blocks, T_first_board = _blocks(seen, enough, tied, start.poses, state)
        fit = solve_pair(blocks, state.of_views(T_first_board))
        state = fit.state
        astray = bad_corners(fit, blocks)
        bad = bad_views(view_spread(fit.residuals, blocks.seen)[: len(paired)])
        if tied.sum() - bad.sum() < LEAST_VIEWS:
            bad[:] = False
        if not (bad.any() or astray.any()):
            break
        off = _rms_of_views(fit.residuals, blocks.seen)
        disagreeing |= {int(v): float(off[i]) for i, v in enumerate(paired) if bad[i]}
        tied[paired[bad]] = False
        seen = seen.without(_of_all_views(astray, paired, len(seen), ~bad))
        enough = np.asarray(enough & seen.enough)
        tied &= np.asarray(enough.all(axis=1))
    paired, blocks, T_first_board = _blocks(seen, enough, tied, start.poses, state)
    fit = solve_pair(blocks, state.of_views(T_first_board))
    left_out = {
        v: LeftOut(views.ids[v], BLURRED.format(eye=eye), off)
        for v, (eye, off) in start.blurred.items()
    } | {v: LeftOut(views.ids[v], APART, off) for v, off in disagreeing.items()}
    return Solution(
        views,
        fit,
        blocks,
        paired,
        tuple(left_out[v] for v in sorted(left_out)),
        start.rms_px,
        start.swapped,
        start.turned,
        start.agreeing,
    )


def _blocks(
    seen: Observations, enough: Bool, tied: Bool, poses: tuple[Float64, Float64], state: State
) -> tuple[Int64, Observations, Float64]:
    """Views of both eyes, then those of the left and of the right alone; and first poses."""
    paired = np.flatnonzero(tied)
    lefts, rights = (np.flatnonzero(enough[:, eye] & ~tied) for eye in range(2))
    order = np.concatenate([paired, lefts, rights])
    blocks = seen.of_views(order)
    shown = np.ones(blocks.seen.shape, np.bool_)
    shown[len(paired) : len(paired) + len(lefts), 1] = False
    shown[len(paired) + len(lefts) :, 0] = False
    from_right = np.linalg.inv(state.T_eye_first[1]) @ poses[1][rights]
    T_first_board = np.concatenate([poses[0][paired], poses[0][lefts], from_right])
    return paired, blocks.without(~shown), T_first_board


def _of_all_views(astray: Bool, paired: Int64, views: int, good: Bool) -> Bool:
    """(V, E, N) corners of paired views that stay, marked where they are astray."""
    marked = np.zeros((views, *astray.shape[1:]), np.bool_)
    marked[paired[good]] = astray[: len(paired)][good]
    return marked


def _poses_of_all(views: int, fit: Fit, which: Int64) -> Float64:
    poses = np.tile(np.eye(4), (views, 1, 1))
    poses[which] = fit.state.T_first_board
    return poses


def _inverse(T: Float64) -> Float64:
    return np.asarray(np.linalg.inv(T))


def _of_views(fit: Fit, views: Bool) -> Fit:
    return replace(fit, residuals=fit.residuals[views], weights=fit.weights[views])


def _rms_of_views(residuals: Float64, seen: Bool) -> Float64:
    """(V,) px."""
    squares = np.where(seen, (residuals**2).sum(axis=-1), 0.0).sum(axis=(1, 2))
    return np.asarray(np.sqrt(squares / np.maximum(seen.sum(axis=(1, 2)), 1)))
