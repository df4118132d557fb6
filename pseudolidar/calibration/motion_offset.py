"""The disparity offset of a rig that makes its motion consistent: expansion against disparity.

What comes nearer grows in the picture and in disparity by the same factor. An offset of the
disparities breaks that. It is an unknown of all motions together, `offset (1 + x^2)` with x the
tangent of the angle to the optical axis: what a rotation of one camera about the vertical makes.
A wrong focal length or baseline scales all motions alike and breaks nothing: it cannot be seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.geometry.pnp import CAUCHY_ITERATIONS, RelativePose, linearised
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig

# What a rig is expected to be off by, one standard deviation, px. The tracks are too sure of
# themselves by about a factor of 10, so the expectation counts as much more.
PRIOR_PX, TOO_SURE = 1.0, 10.0
ITERATIONS, CONVERGED_PX = 20, 1e-5


@dataclass(frozen=True, eq=False)
class MotionOffset:
    """The offset that fits all motions.

    Args:
        offset_px: of the disparities on the optical axis.
        information: (P,) of each motion, 1/px^2, as its tracks alone tell.
        own_px: (P,) what each motion alone would say.
        motions: with the offset taken off.
    """

    offset_px: float
    information: Float64
    own_px: Float64
    motions: tuple[RelativePose, ...]

    def without(self, left_out: Float64) -> float:
        """The offset of all motions but the marked ones (P,)."""
        information = np.where(left_out, 0.0, self.information)
        return float(np.sum(information * self.own_px) / (information.sum() + _PRIOR))


_PRIOR = (TOO_SURE / PRIOR_PX) ** 2


def vergence(u: Float64, rig: StereoRig) -> Float64:
    """(N,) `1 + x^2` of columns u, px: the shape of what turning the right camera adds."""
    return np.asarray(1.0 + ((u - rig.left.K[0, 2]) / rig.left.K[0, 0]) ** 2)


def vergence_coefficients(offset_px: float, rig: StereoRig) -> Float64:
    """(8,) of a `DisparityCorrection` that is `offset_px (1 + x^2)`."""
    half_width = (rig.left.width_px - 1) / 2
    slope = half_width / rig.left.K[0, 0]
    start = (half_width - rig.left.K[0, 2]) / rig.left.K[0, 0]
    coefficients = np.zeros(8)
    coefficients[[0, 2, 4]] = 1 + start**2, 2 * slope * start, slope**2
    return coefficients * offset_px


def joint_offset(
    motions: Sequence[RelativePose], rig: StereoRig, *, poses_known: bool = False
) -> MotionOffset:
    """Solve for the offset and all motions together, robustly.

    Each motion is eliminated by its Schur complement, so that one number is left.

    Args:
        motions: at least one, found without an offset.
        rig: its correction is not used.
        poses_known: the motions are right and only the offset is sought.
    """
    offset_px, motions = 0.0, tuple(motions)
    for iteration in range(ITERATIONS):
        parts = [
            _eliminated(motion, rig, offset_px, forgetting=iteration >= CAUCHY_ITERATIONS)
            for motion in motions
        ]
        information = np.array([part.information for part in parts])
        pull = np.array([part.pull for part in parts])
        step_px = float((pull.sum() - _PRIOR * offset_px) / (information.sum() + _PRIOR))
        if not poses_known:
            motions = tuple(part.moved(step_px) for part in parts)
        offset_px += step_px
        if abs(step_px) < CONVERGED_PX and iteration > CAUCHY_ITERATIONS:
            break
    own_px = offset_px - step_px + pull / np.maximum(information, np.finfo(float).tiny)
    return MotionOffset(offset_px, information, own_px, motions)


@dataclass(frozen=True, eq=False)
class _Eliminated:
    """What one motion says of the offset when the motion itself is unknown."""

    motion: RelativePose
    information: float
    pull: float
    step: Float64
    step_by_offset: Float64

    def moved(self, offset_step_px: float) -> RelativePose:
        twist = self.step - self.step_by_offset * offset_step_px
        return replace(self.motion, T_to_from=exp_twist(twist) @ self.motion.T_to_from)


def _eliminated(
    motion: RelativePose, rig: StereoRig, offset_px: float, *, forgetting: bool
) -> _Eliminated:
    tracks = motion.tracks
    shape = np.stack([vergence(uv[:, 0], rig) for uv in (tracks.uv_from, tracks.uv_to)])
    at = linearised(motion.T_to_from, tracks, rig, offset_px=offset_px * shape)
    by_offset = -at.by_seed * shape[0][:, None]
    by_offset[:, 2] += shape[1]
    columns = np.concatenate([at.by_pose, by_offset[:, :, None]], axis=2)
    weights = at.weights(forgetting=forgetting)
    weighted = at.whitened(columns) * weights[:, None, None]
    H = np.einsum("nij,nik->jk", columns, weighted)
    b = np.einsum("nij,ni->j", weighted, at.error)
    step, step_by_offset = np.linalg.solve(H[:6, :6], np.column_stack([b[:6], H[:6, 6]])).T
    return _Eliminated(
        motion=replace(motion, information=H[:6, :6], weights=weights),
        information=float(H[6, 6] - H[6, :6] @ step_by_offset),
        pull=float(b[6] - H[6, :6] @ step),
        step=step,
        step_by_offset=step_by_offset,
    )
