"""How the camera moved from a keyframe to another frame: roughly first, then precisely."""

from __future__ import annotations

import numpy as np

from pseudolidar.geometry.lucas_kanade import follow
from pseudolidar.geometry.pnp import KERNEL_SIGMA, RelativePose, first_pose, refined_pose
from pseudolidar.geometry.tracking import (
    ITERATIONS_WARPED,
    WINDOW_OVER_TIME_PX,
    Seeds,
    relative_pose,
    track_warped,
)
from pseudolidar.geometry.warping import Warp
from pseudolidar.mapping.keyframe import Keyframe, Sight
from pseudolidar.mapping.second_motion import Expected, agreeing, camera_motion, left_over
from pseudolidar.mapping.steps_apart import apart
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.point_tracks import PointTracks

# Every so many corners are enough for a first pose; pictures warped by a guess are compared on
# these halvings, for guesses off by some pixels.
ROUGH_EVERY, ROUGH_LEVELS = 3, 2
# Another motion counts if so many points agree with it; so many are looked for after the first.
LEAST_SECOND, MORE_MOTIONS = 30, 2
# Median of chi-square with the three degrees of freedom of (u, v, d).
MEDIAN_CHI2_3 = 2.366
# Errors of tracks are alike next to each other (windows overlap, seeds are shared): motions err
# more than independent ones would, in variance. Measured on rendered worlds, 2026-11.
ALIKE = 6.0


def registered(
    key: Keyframe,
    sight: Sight,
    rig: StereoRig,
    guess: Float64 | None,
    correction: DisparityCorrection | None,
    *,
    expected: Expected | None = None,
) -> RelativePose | None:
    """The camera's motion from a keyframe to a frame.

    Most corners may be on something that moves by itself. So where the motion that most of them
    agree on is not the expected one, or none was expected, other motions are looked for among the
    corners that are left, and `camera_motion` tells which one is the camera's.

    Args:
        key: the earlier frame.
        sight: the later one.
        rig: rectified; its own correction is not used.
        guess: (4, 4) `T_to_from` near which points are looked for; None to look without a guess.
        correction: systematic error of the disparities.
        expected: the motion if the camera goes on as before; None where that is unknown.

    Returns:
        The motion with its tracks as measured; None where too few points agree on one.
    """
    first = _motion(key, key.seeds, sight, rig, guess, correction)
    if first is None or (expected is not None and expected.comes_true(first)):
        return first
    motions = [first]
    if expected is not None:
        motions += _another(precisely(key, sight, rig, expected.T_to_from, correction), motions)
    for _ in range(MORE_MOTIONS):
        left = left_over(key.seeds, motions)
        if len(left) < LEAST_SECOND:
            break
        more = _another(_motion(key, left, sight, rig, guess, correction), motions)
        if not more:
            break
        motions += more
    return camera_motion(motions, expected, rig)


def _another(motion: RelativePose | None, known: list[RelativePose]) -> list[RelativePose]:
    """The motion alone, if enough points agree with it and it differs from all known; else none."""
    if motion is None or inliers(motion) < LEAST_SECOND:
        return []
    return [motion] if all(apart(motion.T_to_from, one.T_to_from) for one in known) else []


def _motion(
    key: Keyframe,
    seeds: Seeds,
    sight: Sight,
    rig: StereoRig,
    guess: Float64 | None,
    correction: DisparityCorrection | None,
) -> RelativePose | None:
    """The motion that most of the `seeds` agree on, made precise by all corners of the keyframe."""
    rough = None if guess is None else _rough(key, seeds, sight, rig, guess, correction)
    if rough is None:
        found = relative_pose(key.sight.pair, sight.pair, rig, np.eye(4), seeds=seeds)
        if found is None:
            return None
        rough = found.T_to_from
    return precisely(key, sight, rig, rough, correction)


def precisely(
    key: Keyframe,
    sight: Sight,
    rig: StereoRig,
    T_to_from: Float64,
    correction: DisparityCorrection | None,
) -> RelativePose | None:
    """As `registered`, where the motion is known to a few pixels."""
    tracks = track_warped(
        key.sight.pair, sight.pair, rig, T_to_from, seeds=key.seeds, correction=correction
    )
    tracks = tracks[sight.still(tracks.uv_to)]
    return refined_pose(T_to_from, tracks, rig, offset_px=offsets_px(tracks, rig, correction))


def inliers(motion: RelativePose) -> int:
    """How many points agree with a motion."""
    return int(agreeing(motion).sum())


def covariance(motion: RelativePose) -> Float64:
    """(6, 6) of a twist on the left of `T_to_from`: by how far its points disagree.

    The inverse of the information, times the variance that residuals really have, times what errors
    of neighbouring points have in common.
    """
    chi2 = KERNEL_SIGMA**2 * (1.0 / np.sqrt(motion.weights) - 1.0)  # Geman-McClure, turned round
    spread = float(np.median(chi2)) / MEDIAN_CHI2_3
    return np.asarray(ALIKE * spread * np.linalg.inv(motion.information))


def offsets_px(
    tracks: PointTracks, rig: StereoRig, correction: DisparityCorrection | None
) -> Float64:
    """(2, N) px that the disparities of tracks are too large by, before and after."""
    if correction is None:
        return np.zeros((2, len(tracks)))
    size_px = rig.left.size_px
    return np.stack(
        [
            correction.offset_px(d, uv[:, 0], uv[:, 1], size_px)
            for d, uv in ((tracks.d_from, tracks.uv_from), (tracks.d_to, tracks.uv_to))
        ]
    )


def _rough(
    key: Keyframe,
    seeds: Seeds,
    sight: Sight,
    rig: StereoRig,
    guess: Float64,
    correction: DisparityCorrection | None,
) -> Float64 | None:
    """(4, 4) that most of a few corners agree on, found in pictures warped by the guess."""
    warp = Warp.by(key.sight.pair.disparity, rig, guess, correction)
    some = seeds[::ROUGH_EVERY]
    at, found = follow(
        key.sight.pair.left,
        warp.left(sight.pair.left),
        some.uv,
        some.uv,
        window_px=WINDOW_OVER_TIME_PX,
        levels=ROUGH_LEVELS,
        iterations=ITERATIONS_WARPED,
    )
    there = warp.at(at)[:, :2]
    uv = some.uv.astype(np.float64)
    tracks = PointTracks(uv, some.d, there, some.d)
    tracks = PointTracks(uv, some.d - offsets_px(tracks, rig, correction)[0], there, some.d)
    return first_pose(tracks[found & sight.still(there)], rig)
