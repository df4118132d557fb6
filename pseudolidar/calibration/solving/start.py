"""One camera from scratch: a first guess of its focal length, poses of the board, and the fit."""

from __future__ import annotations

import numpy as np

from pseudolidar.calibration.solving.bundle import Fit, State, adjust
from pseudolidar.calibration.solving.lens_terms import INTRINSICS, Model, parameters
from pseudolidar.calibration.solving.observations import Observations
from pseudolidar.calibration.solving.robust import Cauchy
from pseudolidar.structures.arrays import AnyArray, Bool, Float64, Int64

# Focal lengths that are tried, as shares of the picture's width: from wide lenses to long ones.
FOCAL_SHARES: dict[str, tuple[float, ...]] = {
    "pinhole": (0.45, 0.7, 1.0, 1.6, 2.5, 4.0),
    "fisheye": (0.22, 0.3, 0.42, 0.6, 0.9),
}
# Directions that a pose is found from, rad off the axis: they become points of a plane.
POSE_LIMIT_RAD = np.deg2rad(75.0)
# A pose of a plane needs four corners.
POSE_CORNERS = 4
# Steps on the focal length alone, then on everything, before candidates are compared.
FOCAL_STEPS, FIRST_STEPS = 8, 10
ROUNDS = 6
# Views that candidates are tried on.
FIRST_VIEWS = 8


def solve_eye(seen: Observations, model: Model, size_px: tuple[int, int]) -> Fit:
    """Calibrate one camera.

    Args:
        seen: what the one eye saw; every view has some corners.
        model: of its lens.
        size_px: (width, height) of its pictures.
    """
    simplest: Model = "fisheye" if model == "fisheye" else "pinhole"
    few = seen.of_views(_telling_views(seen))
    shares = FOCAL_SHARES[simplest]
    tried = [_from_focal(few, simplest, size_px, share * size_px[0]) for share in shares]
    best = min(tried, key=_median_error).state
    vector = np.zeros(parameters(model))
    vector[: len(best.cameras[0])] = best.cameras[0]
    state = State(model, (vector,), best.T_eye_first, best.T_first_board)
    return adjust(seen, state.of_views(poses_of(seen, state)), weighting=Cauchy(), rounds=ROUNDS)


def _telling_views(seen: Observations) -> Int64:
    """Some views with many corners, evenly from the first to the last."""
    corners = seen.seen.sum(axis=(1, 2))
    many = np.flatnonzero(corners >= np.median(corners))
    return np.asarray(
        many[np.unique(np.linspace(0, len(many) - 1, FIRST_VIEWS).round().astype(int))]
    )


def poses_of(seen: Observations, state: State) -> Float64:
    """(V, 4, 4) poses of the board in one eye whose camera is known and stays as it is.

    A plane that is seen from far has two poses that look almost alike; both are tried.
    """
    found = [_two_poses(seen, state, view) for view in range(len(seen))]
    fits = [_refined(seen, state, np.stack([pair[n] for pair in found])) for n in range(2)]
    errors = np.stack([(fit.residuals**2).sum(axis=(1, 2, 3)) for fit in fits])
    better = np.argmin(np.where(np.isfinite(errors), errors, np.inf), axis=0)
    both = np.stack([fit.state.T_first_board for fit in fits])
    return np.asarray(both[better, np.arange(len(seen))])


def _from_focal(seen: Observations, model: Model, size_px: tuple[int, int], focal_px: float) -> Fit:
    """The fit that a guess of the focal length leads to, after a few steps."""
    vector = np.zeros(parameters(model))
    vector[:INTRINSICS] = focal_px, focal_px, (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
    state = State(model, (vector,), np.eye(4)[None], np.tile(np.eye(4), (len(seen), 1, 1)))
    state = state.of_views(poses_of(seen, state))
    held: Bool = np.ones(len(vector), np.bool_)
    held[:2] = False
    fit = adjust(seen, state, weighting=Cauchy(), fixed=held, steps=FOCAL_STEPS)
    state = fit.state.of_views(poses_of(seen, fit.state))
    return adjust(seen, state, weighting=Cauchy(), rounds=2, steps=FIRST_STEPS)


def _refined(seen: Observations, state: State, T_first_board: Float64) -> Fit:
    fixed: Bool = np.ones(parameters(state.model), np.bool_)
    return adjust(seen, state.of_views(T_first_board), fixed=fixed, steps=FOCAL_STEPS)


def _two_poses(seen: Observations, state: State, view: int) -> tuple[Float64, Float64]:
    """The two poses of a plane that explain a view, the likelier first."""
    import cv2

    part = seen.seen[view, 0]
    plane, near = _on_plane(seen.uv[view, 0][part], state)
    points = seen.points_m[part][near]
    if len(points) >= POSE_CORNERS:
        try:
            _, turns, shifts, _ = cv2.solvePnPGeneric(
                points, plane[near], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
            )
        except cv2.error:  # corners on one line
            turns, shifts = (), ()
        poses = [_matrix(r, t) for r, t in zip(turns, shifts, strict=True)]
        poses = [T for T in poses if np.isfinite(T).all() and T[2, 3] > 0]
        if poses:
            return poses[0], poses[-1]
    return _in_front(points), _in_front(points)


def _on_plane(uv: Float64, state: State) -> tuple[Float64, Bool]:
    """(N, 2) where pixels lie on the plane at distance one, and which are near enough to the axis.

    Distortion is taken as it is in the middle of what the model says, which suffices to begin.
    """
    vector = state.cameras[0]
    bent = (uv - vector[2:INTRINSICS]) / vector[:2]
    r = np.linalg.norm(bent, axis=-1)
    k = vector[INTRINSICS:]
    if state.model == "fisheye":
        angle = r.copy()
        for _ in range(8):
            a2 = angle**2
            angle = np.minimum(r / np.maximum(1 + a2 * (k[0] + a2 * k[1]), 0.2), np.pi / 2)
        near = angle < POSE_LIMIT_RAD
        return bent * (np.tan(np.where(near, angle, 0.0)) / np.maximum(r, 1e-12))[:, None], near
    plane = bent.copy()
    for _ in range(8):
        r2 = (plane**2).sum(axis=-1, keepdims=True)
        plane = bent / np.clip(1 + r2 * (k[0] + r2 * k[1]), 0.3, 3.0)
    return plane, np.ones(len(uv), np.bool_)


def _matrix(rotation: AnyArray, shift: AnyArray) -> Float64:
    import cv2

    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(shift)
    return T


def _in_front(points: Float64) -> Float64:
    """A board straight ahead: where no pose could be found."""
    T = np.eye(4)
    size = float(np.ptp(points)) if points.size else 1.0
    T[2, 3] = 3 * max(size, 1e-3)
    return T


def _median_error(fit: Fit) -> float:
    lengths = np.linalg.norm(fit.residuals, axis=-1)[fit.weights > 0]
    error = float(np.median(lengths)) if len(lengths) else np.inf
    return error if np.isfinite(error) else np.inf
