"""The disparity offset of a rig that makes its motion consistent: expansion against disparity.

What comes nearer grows in the picture and in disparity by the same factor. An offset of the
disparities breaks that. It is an unknown of all motions together, `offset (1 + x^2)` with x the
tangent of the angle to the optical axis: what a rotation of one camera about the vertical makes;
and, where the motions ask for it, `bend x^2` more: what lenses leave. A wrong focal length or
baseline scales all motions alike and breaks nothing: it cannot be seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.geometry.pnp import CAUCHY_ITERATIONS, RelativePose, normal_equations
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection

# What a rig is expected to be off by, one standard deviation, px: offset and bend. The tracks are
# too sure of themselves by about a factor of 10, so the expectation counts as much more.
PRIOR_PX, TOO_SURE = (1.0, 1.0), 10.0
ITERATIONS, CONVERGED_PX = 20, 1e-5


@dataclass(frozen=True, eq=False)
class MotionOffset:
    """The offset that fits all motions.

    Args:
        shape_px: (K,) offset, and bend where that was sought.
        information: (P, K, K) of each motion, 1/px^2, as its tracks alone tell.
        wish: (P, K) information times what each motion alone would say.
        motions: with the offset taken off.
        length_by_shape: (P, K) change of their lengths with offset and bend, m/px.
    """

    shape_px: Float64
    information: Float64
    wish: Float64
    motions: tuple[RelativePose, ...]
    length_by_shape: Float64

    def without(self, left_out: Bool) -> Float64:
        """(K,) of all motions but the marked ones (P,)."""
        kept = ~left_out
        return _solved(self.information[kept].sum(axis=0), self.wish[kept].sum(axis=0))


def shape_of(u: Float64, rig: StereoRig, unknowns: int) -> Float64:
    """(N, K) `1 + x^2` and `x^2` of columns u (N,) px, the first K of them."""
    squared = ((u - rig.left.K[0, 2]) / rig.left.K[0, 0]) ** 2
    return np.stack([1.0 + squared, squared], axis=1)[:, :unknowns]


def correction_coefficients(
    shape_px: Float64, rig: StereoRig, *, depth_factor: float = 1.0
) -> Float64:
    """(10,) of a `DisparityCorrection` that takes the offset off and then stretches depths.

    Args:
        shape_px: (K,) `offset (1 + x^2)`, and `bend x^2` where given.
        rig: of the pictures.
        depth_factor: true depths by those that are left without the offset.
    """
    half_width = (rig.left.width_px - 1) / 2
    slope = half_width / rig.left.K[0, 0]
    start = (half_width - rig.left.K[0, 2]) / rig.left.K[0, 0]
    coefficients = np.zeros(DisparityCorrection.TERMS)
    coefficients[[0, 2, 4]] = start**2, 2 * slope * start, slope**2
    coefficients *= shape_px.sum()
    coefficients[0] += shape_px[0]
    coefficients /= depth_factor
    shrunk = 1.0 - 1.0 / depth_factor  # of disparity + doffs, which depths are inverse to
    coefficients[0] += shrunk * rig.doffs_px
    coefficients[1] = shrunk * DisparityCorrection.DISPARITY_UNIT_PX
    return coefficients


def joint_offset(
    motions: Sequence[RelativePose],
    rig: StereoRig,
    *,
    unknowns: int = 1,
    poses_known: bool = False,
) -> MotionOffset:
    """Solve for the offset and all motions together, robustly.

    Each motion is eliminated by its Schur complement, so that one or two numbers are left.

    Args:
        motions: at least one, found without an offset.
        rig: its correction is not used.
        unknowns: 1 for the offset alone, 2 for offset and bend.
        poses_known: the motions are right and only the offset is sought.
    """
    shape_px, motions = np.zeros(unknowns), tuple(motions)
    for iteration in range(ITERATIONS):
        parts = [
            eliminated(motion, rig, shape_px, forgetting=iteration >= CAUCHY_ITERATIONS)
            for motion in motions
        ]
        information = np.stack([part.information for part in parts])
        wish = np.stack([part.pull + part.information @ shape_px for part in parts])
        step_px = _solved(information.sum(axis=0), wish.sum(axis=0)) - shape_px
        if not poses_known:
            motions = tuple(part.moved(step_px) for part in parts)
        shape_px = shape_px + step_px
        if np.abs(step_px).max() < CONVERGED_PX and iteration > CAUCHY_ITERATIONS:
            break
    lengths = np.stack([part.length_by_shape for part in parts])
    return MotionOffset(shape_px, information, wish, motions, lengths)


def _solved(information: Float64, wish: Float64) -> Float64:
    prior = np.diag((TOO_SURE / np.array(PRIOR_PX[: len(wish)])) ** 2)
    return np.asarray(np.linalg.solve(information + prior, wish))


@dataclass(frozen=True, eq=False)
class Eliminated:
    """What one motion says of the offset when the motion itself is unknown.

    Args:
        motion: as it was given, with information and weights at that offset.
        information: (K, K) 1/px^2, as its tracks alone tell.
        pull: (K,) 1/px, where the tracks want the offset to go.
        step: (6,) twist on the left of `T_to_from` that the tracks want, at this offset.
        step_by_shape: (6, K) what less of it each px of offset makes.
    """

    motion: RelativePose
    information: Float64
    pull: Float64
    step: Float64
    step_by_shape: Float64

    @property
    def length_by_shape(self) -> Float64:
        """(K,) change of the motion's length with offset and bend, m/px."""
        t = self.motion.T_to_from[:3, 3]
        along = t / np.linalg.norm(t)
        # A rotation on the left turns t and leaves its length.
        return np.asarray(-np.sum(along[:, None] * self.step_by_shape[:3], axis=0))

    def moved(self, shape_step_px: Float64) -> RelativePose:
        """The motion as it is best where the offset changes by (K,) px."""
        twist = self.step - self.step_by_shape @ shape_step_px
        return replace(self.motion, T_to_from=exp_twist(twist) @ self.motion.T_to_from)


def eliminated(
    motion: RelativePose, rig: StereoRig, shape_px: Float64, *, forgetting: bool
) -> Eliminated:
    """What a motion says of the offset, near an offset.

    Args:
        motion: near its best; its tracks as measured.
        rig: rectified; its own correction is not used.
        shape_px: (K,) the offset, and the bend where that is sought.
        forgetting: whether outliers are forgotten, or still pull.
    """
    tracks = motion.tracks
    shape = [shape_of(uv[:, 0], rig, len(shape_px)) for uv in (tracks.uv_from, tracks.uv_to)]
    offset_px = np.stack([np.sum(each * shape_px, axis=1) for each in shape])
    at = normal_equations(motion.T_to_from, tracks, rig, offset_px=offset_px, forgetting=forgetting)
    size = 6 + len(shape_px)
    H, b = at.H[:size, :size], at.b[:size]
    solved = np.asarray(np.linalg.solve(H[:6, :6], np.column_stack([b[:6], H[:6, 6:]])))
    return Eliminated(
        motion=replace(motion, information=H[:6, :6], weights=at.weights),
        information=H[6:, 6:] - H[6:, :6] @ solved[:, 1:],
        pull=b[6:] - H[6:, :6] @ solved[:, 0],
        step=solved[:, 0],
        step_by_shape=solved[:, 1:],
    )
