"""What becomes of the depths' scale, which motion cannot see, where an offset is taken off.

An offset changes near depths too: -0.5 px make 5 m out of 5.04 m, and 20 m out of 20.5 m. Errors
of a rig's calibration are no offset alone. It was made so that depths are right where its boards
stood, so an offset that it left comes with a scale `f B` that makes up for it near the cameras.
Taken off without that scale, the offset takes correct near depths away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pseudolidar.errors import MotionInsufficient
from pseudolidar.geometry.motion_offset import MotionOffset, shape_of
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import UNREFINED_SIGMA_PX, StereoRig
from pseudolidar.structures.disparity import ONE_SIGMA_SHARE

ScaleFrom = Literal["auto", "poses", "near", "kept"]
# Near depths are those of the nearest tenth of the tracks.
NEAR_SHARE = 0.9
# A survey by GPS and IMU is right to this: 0.05 km/h (OXTS RT3003) at 25 km/h.
SURVEY_REL = 0.002
# A scale less sure than this is no better than that of the rig; one further off than this is no
# error of a calibration, but poses in another unit or of another thing.
MOST_UNSURE_REL, LARGEST_REL = 0.01, 0.05
# What offset, bend and scale leave of a rig, px: 0.17 on other frames of KITTI stereo 2015.
LEFT_PX = 0.2


@dataclass(frozen=True, eq=False)
class DepthScale:
    """By how much depths are longer than the rig makes them once its offset is taken off.

    Args:
        by: `poses` that somebody surveyed; `near` depths stay what they were; `kept`, f B is right.
        factor: true depth by depth.
        by_shape: (K,) change of the factor with offset and bend, 1/px.
        sigma_rel: one standard deviation of the factor where those are right; None where nothing
            was measured.
        near_m: nearest tenth of the tracks.
        not_poses: why poses that there are were not taken, or nothing.
    """

    by: Literal["poses", "near", "kept"]
    factor: float
    by_shape: Float64
    sigma_rel: float | None
    near_m: float
    not_poses: str = ""

    @property
    def seen(self) -> bool:
        """Whether it was measured."""
        return self.by == "poses"

    def residual_px(self, offset_sigma_px: float) -> float:
        """What corrected disparities still err by together, one standard deviation."""
        left_px = LEFT_PX if self.seen else UNREFINED_SIGMA_PX
        return float(np.hypot(left_px, offset_sigma_px))

    def whole_sigma_rel(self, offset_sigma_px: float) -> float | None:
        """Of the factor, with what an error of the offset does to it."""
        if self.sigma_rel is None:
            return None
        return float(np.hypot(self.sigma_rel, self.by_shape[0] * offset_sigma_px))

    def lines(self, offset_sigma_px: float) -> tuple[str, ...]:
        """For people."""
        sigma_rel = self.whole_sigma_rel(offset_sigma_px)
        change = f"{abs(self.factor - 1):.1%} {'longer' if self.factor >= 1 else 'shorter'}"
        if sigma_rel is not None and self.seen:
            return (
                f"scale: depths {change} (+- {sigma_rel:.1%}), by the poses of the source; if "
                "those come from these cameras, they prove nothing: --by.scale near",
            )
        unseen = "scale: the scale f B cannot be seen from motion"
        if self.by == "kept":
            end = "it stays as calibrated, and near depths change with the offset"
        else:
            end = f"so depths at {self.near_m:.1f} m stay as calibrated, by making all {change}"
        why = (f"scale: {self.not_poses}",) if self.not_poses else ()
        return (*why, f"{unseen}, {end}; sigma keeps {UNREFINED_SIGMA_PX} px")

    def as_dict(self, offset_sigma_px: float) -> dict[str, Any]:
        """For JSON."""
        return {
            "scale_seen": self.seen,
            "scale_by": self.by,
            "scale_factor": self.factor,
            "scale_sigma_rel": self.whole_sigma_rel(offset_sigma_px),
        }


def depth_scale(
    found: MotionOffset, rig: StereoRig, surveyed: Sequence[Float64], *, gap: int, by: ScaleFrom
) -> DepthScale:
    """The scale that goes with an offset.

    Args:
        found: the offset, and the motions without it.
        rig: without a correction.
        surveyed: (4, 4) of each motion as somebody else knows it, or of none.
        gap: frames between the pairs of a motion; such motions share pictures.
        by: what tells it; `auto` takes poses where there are some that tell it surely, else near
            depths.

    Raises:
        MotionInsufficient: poses are asked for, and there are none, or they do not tell it.
    """
    near = _by_near_depths(found, rig)
    if by == "near":
        return near
    if by == "kept":
        return replace(near, by="kept", factor=1.0, by_shape=np.zeros_like(near.by_shape))
    if not surveyed or len(surveyed) != len(found.motions):
        if by == "poses":
            raise MotionInsufficient(
                f"poses of {len(surveyed)} of {len(found.motions)} motions",
                want="poses of all frames, as --by.scale poses asks for",
                fix="Leave --by.scale out: near depths then stay as they were calibrated.",
            )
        return near
    scale = _by_poses(found, surveyed, gap, near.near_m)
    doubt = _doubt(scale)
    if not doubt:
        return scale
    if by == "poses":
        raise MotionInsufficient(
            doubt,
            want=f"+- {MOST_UNSURE_REL:.0%} or better, {LARGEST_REL:.0%} at most",
            fix="Leave --by.scale out: near depths then stay as they were calibrated.",
        )
    return replace(near, not_poses=f"{doubt}: not used")


def _doubt(scale: DepthScale) -> str:
    """What speaks against poses, or nothing."""
    assert scale.sigma_rel is not None
    says = f"the poses of the source make depths {scale.factor - 1:+.1%} longer"
    if scale.sigma_rel > MOST_UNSURE_REL:
        return f"{says}, +- {scale.sigma_rel:.1%}"
    if abs(scale.factor - 1) > LARGEST_REL:
        return f"{says}, more than a calibration errs by"
    return ""


def _by_near_depths(found: MotionOffset, rig: StereoRig) -> DepthScale:
    """The scale that leaves the disparities of near tracks where they were, by least squares."""
    tracks = [motion.tracks for motion in found.motions]
    d = np.concatenate([each.d_from for each in tracks]) + rig.doffs_px
    u = np.concatenate([each.uv_from[:, 0] for each in tracks])
    least_px = np.quantile(d, NEAR_SHARE)
    d, u = d[d >= least_px], u[d >= least_px]
    shape = shape_of(u, rig, len(found.shape_px))
    by_shape = -np.sum(shape * d[:, None], axis=0) / np.sum(d * d)
    factor = 1.0 + float(np.sum(by_shape * found.shape_px))
    return DepthScale("near", factor, by_shape, None, rig.fB_px_m / float(least_px))


def _by_poses(
    found: MotionOffset, surveyed: Sequence[Float64], gap: int, near_m: float
) -> DepthScale:
    """Surveyed lengths of the motions by those that were seen; the median motion counts."""
    from scipy.stats import t as student

    lengths_m = np.array([motion.distance_m for motion in found.motions])
    ratios = np.array([float(np.linalg.norm(T[:3, 3])) for T in surveyed]) / lengths_m
    factor = float(np.median(ratios))
    blocks = max(3.0, len(ratios) / gap)
    spread = robust_sigma(ratios - factor)
    wider = student.ppf((1 + ONE_SIGMA_SHARE) / 2, blocks - 1)
    sigma_rel = float(np.hypot(spread * wider / np.sqrt(blocks), SURVEY_REL))
    by_shape = np.median(-ratios[:, None] * found.length_by_shape / lengths_m[:, None], axis=0)
    return DepthScale("poses", factor, by_shape, sigma_rel, near_m)
