"""What the motion of a sequence says of a rig, how surely, and whether it can say it at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pseudolidar.calibration.far_points import FarPoints
from pseudolidar.calibration.motion_scale import DepthScale, ScaleFrom, depth_scale
from pseudolidar.errors import MotionInsufficient
from pseudolidar.geometry.motion_offset import (
    MotionOffset,
    correction_coefficients,
    joint_offset,
)
from pseudolidar.geometry.pnp import RelativePose
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

# Fewer motions say nothing of how far they agree.
MIN_MOTIONS = 6
# Motions that share pictures err alike: the sequence is cut into blocks, at most and at least so
# many, and how they differ is the uncertainty.
MOST_BLOCKS, LEAST_BLOCKS = 10, 3
# Steps between the pictures that are compared, as a share of the distance of near points: below it
# nothing grows by more than tracks err.
LEAST_STEP = 0.02
# Ratio of near to far that is needed: 90 and 10 % quantile of the disparities of tracks.
LEAST_DEPTH_RATIO = 1.3
# An offset that is less sure than this, px, is no better than the rig as it is.
MOST_UNSURE_PX = 0.3
# A motion of whose tracks less than this agrees (mean weight; KITTI 0.5-0.7) contradicts the rest.
LEAST_AGREEMENT, MOST_ODD_SHARE = 0.15, 0.25
# What tracks err by together (windows, resampling, traffic), px, in offset and bend: synthetic
# worlds that have none are found to 0.00 to 0.065 px (2026-11). A bend is taken where it is sure
# by twice that.
TRACKS_PX, TRACKS_BEND_PX, SURE = 0.05, 0.2, 2.0
# The true error has yet another shape. Offsets from motion differ by so much of themselves from
# those by surveyed poses or Velodyne (KITTI 06, drive 0002: 19 and 31 % without a bend).
SHAPE_SHARE = 0.3
# Step of a derivative of something linear.
SMALL = 1e-6


@dataclass(frozen=True, eq=False)
class MotionFit:
    """The disparity offset that makes the motion of a sequence consistent.

    It is `offset_px (1 + x^2) + bend_px x^2`, x being the tangent of the angle to the optical axis.
    Where it is taken off, depths are stretched by `scale`.

    Args:
        offset_px: on the optical axis; measured disparities are too large by it.
        bend_px: what lenses add to the sides; 0 where the motions do not ask for it.
        sigma_px: one standard deviation, from blocks of motions left out, and what those share.
        blocks_px: its part from blocks left out.
        motions: how many pairs of frames were compared.
        frames: how many frames were looked at.
        tracks: how many points were followed in all of them.
        step_m: how far the camera moved in the median pair.
        depths_m: how far near and far tracks are, 10 and 90 % quantile.
        far: what distant points say.
        by_poses_px: offset and bend with the motions held as somebody else surveyed them; None
            where nobody did.
        scale: of the depths, which the motions alone do not tell.
        rig: that it was fitted to, without a correction.
    """

    offset_px: float
    bend_px: float
    sigma_px: float
    blocks_px: float
    motions: int
    frames: int
    tracks: int
    step_m: float
    depths_m: tuple[float, float]
    far: FarPoints
    by_poses_px: tuple[float, float] | None
    scale: DepthScale
    rig: StereoRig

    @property
    def correction(self) -> DisparityCorrection:
        """For the rig. What nobody measured stays as unsure as on a rig that nobody checked."""
        shape_px = np.array([self.offset_px, self.bend_px])
        return DisparityCorrection(
            correction_coefficients(shape_px, self.rig, depth_factor=self.scale.factor),
            residual_px=self.scale.residual_px(self.sigma_px),
            origin=f"motion of {self.frames} frames: {self.offset_text}",
            covariance=self._covariance,
            fitted_m=self.depths_m,
        )

    @property
    def _covariance(self) -> Float64:
        """(10, 10) px^2 of the coefficients: offset and bend, and the scale that goes with them."""
        by_scale = self._by_scale
        columns = [by_scale * (self.scale.sigma_rel or 0.0)]
        follows = (*self.scale.by_shape.tolist(), 0.0)  # a bend that was not sought moves no scale
        for shape, sigma_px, by_shape in zip(
            np.eye(2), (self.sigma_px, TRACKS_BEND_PX), follows, strict=False
        ):
            by_offset = correction_coefficients(shape, self.rig)
            columns.append((by_offset + by_shape * by_scale) * sigma_px)
        none = np.zeros((DisparityCorrection.TERMS,) * 2)
        return sum((np.outer(each, each) for each in columns), none)

    @property
    def _by_scale(self) -> Float64:
        """(10,) change of the coefficients with the factor of depths, about 1."""
        return correction_coefficients(np.zeros(2), self.rig, depth_factor=1.0 + SMALL) / SMALL

    @property
    def offset_text(self) -> str:
        """The offset in a few words."""
        offset = f"{self.offset_px:+.3f} +- {self.sigma_px:.3f} px"
        return f"offset {_shape_text(offset, self.bend_px)}"

    @property
    def lines(self) -> tuple[str, ...]:
        """For people."""
        near_m, far_m = self.depths_m
        surveyed: tuple[str, ...] = ()
        if self.by_poses_px is not None:
            shape = _shape_text(f"{self.by_poses_px[0]:+.3f} px", self.by_poses_px[1])
            surveyed = (f"motion: with the poses of the source held fixed it would be {shape}",)
        return (
            f"motion: {self.offset_text}; from {self.motions} motions of {self.step_m:.2f} m, "
            f"{self.tracks} tracks at {near_m:.1f} to {far_m:.1f} m",
            *surveyed,
            *self.scale.lines(self.sigma_px),
            self.far.conclusion,
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "offset_px": self.offset_px,
            "bend_px": self.bend_px,
            "sigma_px": self.sigma_px,
            "sigma_blocks_px": self.blocks_px,
            "shape": "offset_px (1 + x^2) + bend_px x^2",
            "motions": self.motions,
            "frames": self.frames,
            "tracks": self.tracks,
            "step_m": self.step_m,
            "near_m": self.depths_m[0],
            "far_m": self.depths_m[1],
            "by_poses_px": None if self.by_poses_px is None else list(self.by_poses_px),
            "distant_points": self.far.as_dict(),
            **self.scale.as_dict(self.sigma_px),
        }


def _shape_text(offset: str, bend_px: float) -> str:
    return f"{offset} times (1 + x^2)" + (f", {bend_px:+.2f} x^2" if bend_px else "")


def fitted(
    motions: Sequence[RelativePose],
    rig: StereoRig,
    *,
    frames: int,
    gap: int,
    far: FarPoints,
    surveyed: Sequence[Float64] = (),
    scale: ScaleFrom = "auto",
) -> MotionFit:
    """Solve for the offset, and judge it.

    Args:
        motions: in the order of time, of pairs `gap` frames apart.
        rig: rectified.
        frames: how many frames they come from.
        gap: frames between the two pairs of a motion.
        far: what distant points say.
        surveyed: (4, 4) of each motion as somebody else knows it, or of none.
        scale: what tells the scale of the depths.

    Raises:
        MotionInsufficient: the sequence does not carry the estimate.
    """
    rig = rig.with_correction(None)
    _check_count(len(motions), frames, gap)
    step_m = float(np.median([motion.distance_m for motion in motions]))
    disparities = np.concatenate([motion.tracks.d_from for motion in motions]) + rig.doffs_px
    far_m, near_m = (rig.fB_px_m / np.quantile(disparities, share) for share in (0.1, 0.9))
    _check_step(step_m, float(near_m))
    _check_depths(float(near_m), float(far_m))
    found, blocks_px = _bent_where_sure(motions, rig, gap)
    _check_sure(found, blocks_px)
    offset_px, bend_px = _offset_and_bend(found)
    shared_px = np.hypot(TRACKS_PX, SHAPE_SHARE * offset_px)
    return MotionFit(
        offset_px=offset_px,
        bend_px=bend_px,
        sigma_px=float(np.hypot(blocks_px, shared_px)),
        blocks_px=blocks_px,
        motions=len(motions),
        frames=frames,
        tracks=len(disparities),
        step_m=step_m,
        depths_m=(float(near_m), float(far_m)),
        far=far,
        by_poses_px=_by_poses_px(found, rig, surveyed),
        scale=depth_scale(found, rig, surveyed, gap=gap, by=scale),
        rig=rig,
    )


def _bent_where_sure(
    motions: Sequence[RelativePose], rig: StereoRig, gap: int
) -> tuple[MotionOffset, float]:
    """The solution with a bend where that is sure, else without; and how unsure its offset is."""
    bent = joint_offset(motions, rig, unknowns=2)
    offset_unsure_px, bend_unsure_px = _blocks_px(bent, gap)
    if abs(bent.shape_px[1]) > SURE * np.hypot(bend_unsure_px, TRACKS_BEND_PX):
        return bent, float(offset_unsure_px)
    straight = joint_offset(motions, rig)
    return straight, float(_blocks_px(straight, gap)[0])


def _offset_and_bend(found: MotionOffset) -> tuple[float, float]:
    offset_px, *bend_px = found.shape_px.tolist()
    return offset_px, bend_px[0] if bend_px else 0.0


def _by_poses_px(
    found: MotionOffset, rig: StereoRig, surveyed: Sequence[Float64]
) -> tuple[float, float] | None:
    if len(surveyed) != len(found.motions):
        return None
    held = [replace(motion, T_to_from=T) for motion, T in zip(found.motions, surveyed, strict=True)]
    unknowns = len(found.shape_px)
    return _offset_and_bend(joint_offset(held, rig, unknowns=unknowns, poses_known=True))


def _blocks_px(found: MotionOffset, gap: int) -> Float64:
    """(K,) one standard deviation by the jackknife over blocks of the sequence.

    Few blocks know their own spread badly: Student's distribution says how much wider 68 % is.

    Source: Efron & Tibshirani, An Introduction to the Bootstrap, equation 11.5.
    """
    from scipy.stats import t as student

    n = len(found.motions)
    blocks = min(MOST_BLOCKS, max(LEAST_BLOCKS, n // gap))
    block = np.arange(n) * blocks // n
    without = np.stack([found.without(block == turn) for turn in range(blocks)])
    variance = (blocks - 1) / blocks * np.sum((without - without.mean(axis=0)) ** 2, axis=0)
    wider = student.ppf((1 + ONE_SIGMA_SHARE) / 2, blocks - 1)
    return np.asarray(np.sqrt(variance) * wider)


def _check_count(motions: int, frames: int, gap: int) -> None:
    least = MIN_MOTIONS + gap
    if frames < least:
        raise MotionInsufficient(
            f"{frames} frame(s)",
            want=f"{least} or more that follow one another",
            fix="Take a longer piece of the sequence.",
        )
    if motions < MIN_MOTIONS:
        raise MotionInsufficient(
            f"only {motions} motions found between {frames} frames",
            want=f"{MIN_MOTIONS} or more: frames that follow one another and show the same things",
            fix="Leave no frames out, and take a piece with texture and daylight.",
        )


def _check_step(step_m: float, near_m: float) -> None:
    least_m = LEAST_STEP * near_m
    if step_m < least_m:
        raise MotionInsufficient(
            f"the camera moves {step_m:.3f} m between the frames that are compared",
            want=f"{least_m:.2f} m or more, as near things are {near_m:.1f} m away",
            fix="Take a piece where it drives, forwards at best, or raise the gap.",
        )


def _check_depths(near_m: float, far_m: float) -> None:
    if far_m < LEAST_DEPTH_RATIO * near_m:
        raise MotionInsufficient(
            f"all that is seen is {near_m:.1f} to {far_m:.1f} m away",
            want=f"a depth range: far things {LEAST_DEPTH_RATIO:g} times as far as near ones",
            fix="Take a piece with near and far things in view.",
        )


def _check_sure(found: MotionOffset, blocks_px: float) -> None:
    odd = np.mean([motion.weights.mean() < LEAST_AGREEMENT for motion in found.motions])
    if blocks_px <= MOST_UNSURE_PX and odd <= MOST_ODD_SHARE:
        return
    raise MotionInsufficient(
        f"an offset of {found.shape_px[0]:+.2f} +- {blocks_px:.2f} px, with which "
        f"{odd:.0%} of {len(found.motions)} motions disagree",
        want=f"+- {MOST_UNSURE_PX} px or better, and {MOST_ODD_SHARE:.0%} at most",
        fix="Take a longer piece, with more motion and fewer moving things.",
    )
