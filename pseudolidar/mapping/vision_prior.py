"""Vision's step as what is known before a map is looked at, and what map and step agree on."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.twists import inverted
from pseudolidar.mapping.alignment import Alignment, Prior
from pseudolidar.mapping.fused_path import FusedStep, VisionPart
from pseudolidar.mapping.fused_sight import Anchor
from pseudolidar.mapping.integrity import StepCheck
from pseudolidar.structures.odometry import CameraStep

# How well a step is known that took a wrong one's place, one standard deviation, m and rad.
REPLACED_M, REPLACED_RAD = 0.02, 0.002


def prior_by(
    step: CameraStep, check: StepCheck, anchor: Anchor, *, offset_sigma_px: float
) -> Prior:
    """The pose that a step leads to, and how well that is known.

    Args:
        step: vision's.
        check: what witnesses say of it; its step is taken, which is another one if `wrong`.
        anchor: where it begins.
        offset_sigma_px: doubt of the rig's disparity offset, px. It counts where the pose is held
            against a scan; 0 where it is held against stereo patches, which have the same error.
    """
    T_prior = anchor.place.T_odom_camera @ check.T_from_to
    if check.wrong:
        return Prior.within(T_prior, metres=REPLACED_M, rad=REPLACED_RAD)
    by_offset = step.by_offset * offset_sigma_px
    covariance = step.covariance + np.outer(by_offset, by_offset)
    return Prior(T_prior, np.asarray(np.linalg.inv(covariance)))


def agreed_step(
    anchor: Anchor, step: CameraStep, prior: Prior, found: Alignment, *, follows: float
) -> FusedStep:
    """The step to the pose that was found, and how far it follows when vision's is put right.

    Vision learns more of the rig later and changes its steps; this one then changes with them, by
    the share that it rests on vision.

    Args:
        anchor: where it begins.
        step: vision's.
        prior: the pose that this one leads to.
        found: the pose that the map and the prior agree on.
        follows: 1, or 0 where later changes of vision's step are not to move this one.
    """
    total = np.asarray(np.linalg.inv(found.information))
    gain = total @ prior.information
    others = found.information - prior.information
    return FusedStep(
        inverted(anchor.place.T_odom_camera) @ found.T_odom_sensor,
        gain @ step.covariance @ gain.T + total @ others @ total,
        gain @ step.by_offset,
        VisionPart(anchor.piece, anchor.frame, anchor.frame + 1, step.T_from_to, follows * gain),
    )
