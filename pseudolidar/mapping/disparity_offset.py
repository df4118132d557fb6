"""The rig's disparity offset, as its own motion tells it while it moves.

What comes nearer grows in the picture and in disparity alike, unless disparities are all too large
or too small. Only what was seen so far is used, so that every frame can be told at once.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.geometry.motion_offset import (
    TOO_SURE,
    Eliminated,
    correction_coefficients,
    eliminated,
    shape_of,
)
from pseudolidar.geometry.pnp import RelativePose
from pseudolidar.geometry.tracking import Seeds
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import UNREFINED_SIGMA_PX, StereoRig
from pseudolidar.structures.correction import DisparityCorrection

# The latest motions are solved anew with each new one, as the offset becomes better known.
WINDOW = 8
# What tracks err by together (windows, resampling), px: synthetic worlds that have no offset are
# found to 0.00 to 0.065 px (2026-11).
TRACKS_PX = 0.05
# What a rig may be off by before anything was seen, one standard deviation, px.
PRIOR_PX = 1.0
# Near depths are those of the nearest tenth of the corners.
NEAR_SHARE = 0.9


@dataclass(frozen=True)
class Offset:
    """What is known of a rig's offset, `offset_px (1 + x^2)`, at one moment.

    Depths at which the rig was calibrated stay what they were, so an offset comes with a factor on
    all depths; near corners stand for those depths.

    Args:
        offset_px: measured disparities are too large by it, on the optical axis; drawn to 0 by as
            much as it is unsure.
        sigma_px: one standard deviation.
        factor_by_offset: change of the depth factor with the offset, 1/px.
    """

    offset_px: float = 0.0
    sigma_px: float = PRIOR_PX
    factor_by_offset: float = 0.0

    @property
    def depth_factor(self) -> float:
        """True depths by those that are left once the offset is taken off."""
        return 1.0 + self.factor_by_offset * self.offset_px

    def correction(self, rig: StereoRig) -> DisparityCorrection | None:
        """As a rig takes it; None where nothing is to be corrected."""
        if not self.offset_px:
            return None
        shape_px = np.array([self.offset_px])
        return DisparityCorrection(
            correction_coefficients(shape_px, rig, depth_factor=self.depth_factor),
            float(np.hypot(UNREFINED_SIGMA_PX, self.sigma_px)),
            origin=f"motion while driving: offset {self.offset_px:+.3f} +- {self.sigma_px:.3f} px",
        )


class OffsetEstimate:
    """Gathers what motions say, in their order.

    Args:
        rig: rectified; its own correction is not used.
    """

    def __init__(self, rig: StereoRig) -> None:
        self._rig = rig
        self._recent: deque[RelativePose] = deque()
        self._information, self._wish = (TOO_SURE / PRIOR_PX) ** 2, 0.0
        self._solved_px = 0.0
        self._near = np.zeros(2)
        self.now = Offset()

    def add(self, motion: RelativePose, seeds: Seeds) -> None:
        """Look at a motion, found with `now` taken off.

        Args:
            motion: its tracks as measured.
            seeds: corners of its first frame.
        """
        self._look_near(seeds)
        self._recent.append(unscaled(motion, self.now))
        shape_px = np.array([self._solved_px])
        parts = [eliminated(each, self._rig, shape_px, forgetting=True) for each in self._recent]
        information = self._information + sum(_information(part) for part in parts)
        wish = self._wish + sum(_wish(part, self._solved_px) for part in parts)
        solved_px = wish / information
        step_px = np.array([solved_px - self._solved_px])
        self._recent = deque(part.moved(step_px) for part in parts)
        if len(parts) > WINDOW:
            self._recent.popleft()
            self._information += _information(parts[0])
            self._wish += _wish(parts[0], self._solved_px)
        self._solved_px = float(solved_px)
        sigma_px = float(np.hypot(TRACKS_PX, np.sqrt(TOO_SURE / information)))
        self.now = Offset(_drawn(self._solved_px, sigma_px), sigma_px, self._factor_by_offset)

    def _look_near(self, seeds: Seeds) -> None:
        if not len(seeds):
            return
        d = seeds.d + self._rig.doffs_px
        near = d >= np.quantile(d, NEAR_SHARE)
        shape = shape_of(seeds.uv[near, 0].astype(np.float64), self._rig, 1)[:, 0]
        self._near += np.sum(shape * d[near]), np.sum(d[near] ** 2)

    @property
    def _factor_by_offset(self) -> float:
        """By least squares: the disparities of near corners stay where they were."""
        across, along = self._near
        return float(-across / along) if along > 0 else 0.0


def _drawn(offset_px: float, sigma_px: float) -> float:
    """Drawn to 0 by its doubt: nothing is left of one that is no larger than its sigma.

    Source: James & Stein 1961, the positive part.
    """
    if abs(offset_px) <= sigma_px:
        return 0.0
    return offset_px * (1.0 - (sigma_px / offset_px) ** 2)


def unscaled(motion: RelativePose, offset: Offset) -> RelativePose:
    """The motion as it is without the depth factor of `offset`."""
    T = motion.T_to_from.copy()
    T[:3, 3] /= offset.depth_factor
    return replace(motion, T_to_from=T)


def by_offset(motion: RelativePose, rig: StereoRig, offset: Offset) -> Float64:
    """(6,) per px: twist on the left of an unscaled motion's `T_to_from` that an offset makes."""
    shape_px = np.array([offset.offset_px])
    return -eliminated(motion, rig, shape_px, forgetting=True).step_by_shape[:, 0]


def _information(part: Eliminated) -> float:
    return float(part.information[0, 0])


def _wish(part: Eliminated, offset_px: float) -> float:
    return float(part.pull[0]) + _information(part) * offset_px
