"""How the right eye is turned against what its rig says, from matches of a sequence.

A bar that bends and a mount that is bumped turn one eye against the other. The direction in which
the right eye sees a point is then exp(w) times the one that its rig says; w is pitch about x
(right), yaw about y (down), roll about z (forward). What is seen of it is how far below the row
(the epipolar line) a match lies that its rig puts it on, to first order, x, y in focal lengths:

    v / f = -pitch (1 + y^2) + yaw x y + roll x   +   scale y.

The last term, a difference of the focal lengths, is fitted so that it is not taken for turning.
Yaw shows in the corners alone, where lens models are wrong, too: a rig rectified with care, such as
KITTI's, leaves 1 px there. So the yaw of a rig that nothing turned comes out as tenths of a degree,
which would be many pixels of disparity; its standard deviation has that in it.

Source: Longuet-Higgins 1981, the coplanarity of both rays and the baseline; Cameron, Gelbach and
Miller 2011, covariance where errors go together within pictures and within places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.calibration.check_matches import PairMatches
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Bool, Float64, Int64, check_array
from pseudolidar.structures.camera import StereoRig

NAMES = ("pitch", "yaw", "roll")
# Matches without which nothing is said.
LEAST_MATCHES = 100
# Errors go together within such parts of the picture (columns, rows): its lens model's.
CELLS = (6, 3)
# Row difference that the lens models of a pair rectified with care leave at the corners, px.
LENS_PX = 1.0
# What all matches may be off by together, px: flow draws places towards whole pixels. Of rendered
# pairs that were turned by a known angle 0.02 to 0.04 were left.
TOGETHER_PX = 0.05
# What is turned by fewer standard deviations is not put right.
BELIEVED_SIGMAS = 3.0
# Noise of a match is no less than this, px.
LEAST_NOISE_PX = 0.1
MAX_ITERATIONS, CONVERGED_RAD, DIFFERENCE_RAD = 40, 1e-9, 1e-6


@dataclass(frozen=True, eq=False)
class RiggedMatches:
    """Matches of one rectified pair, those that agree, with its rig.

    Args:
        matches: of the pair.
        rig: rectified rig of its pictures.
    """

    matches: PairMatches
    rig: StereoRig


@dataclass(frozen=True, eq=False)
class EyeRotation:
    """How the right eye is turned.

    Args:
        rotation_rad: (3,) rotation vector, pitch, yaw, roll, in the rectified right camera's axes:
            the directions in which it sees points are turned by it.
        covariance: (3, 3) rad^2 of it, errors of lens models included.
        pairs: how many it is from.
        matches: of them.
        before_px: row difference, median of the pairs' medians.
        after_px: the same with what is believed put right.
    """

    rotation_rad: Float64
    covariance: Float64
    pairs: int
    matches: int
    before_px: float
    after_px: float

    def __post_init__(self) -> None:
        check_array("EyeRotation", "rotation_rad", self.rotation_rad, (3,), np.float64)
        check_array("EyeRotation", "covariance", self.covariance, (3, 3), np.float64)

    @property
    def sigma_rad(self) -> Float64:
        """(3,) one standard deviation of each."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def believed(self) -> Bool:
        """(3,) which of them are there for sure."""
        return np.asarray(np.abs(self.rotation_rad) > BELIEVED_SIGMAS * self.sigma_rad)

    @property
    def gained_px(self) -> float:
        """By how much rows meet better with what is believed put right."""
        return self.before_px - self.after_px

    @property
    def believed_rad(self) -> Float64:
        """(3,) the rotation without what may be nothing."""
        return np.where(self.believed, self.rotation_rad, 0.0)


def eye_rotation(pairs: Sequence[RiggedMatches]) -> EyeRotation | None:
    """Estimate how the right eye is turned; None with fewer matches than say anything.

    Args:
        pairs: matches of pairs of one rig, wherever they were taken.
    """
    pairs = [pair for pair in pairs if len(pair.matches)]
    if sum(len(pair.matches) for pair in pairs) < LEAST_MATCHES:
        return None
    seen = _Seen.of(pairs)
    fitted = np.zeros(4)
    for _ in range(MAX_ITERATIONS):
        step, *_ = _step(seen, fitted)
        fitted = fitted + step
        if np.abs(step).max() < CONVERGED_RAD:
            break
    _, normal, scores = _step(seen, fitted)
    inverse = np.linalg.pinv(normal)
    spread = sum(_spread(scores, cluster) for cluster in (seen.pair, seen.cell))
    covariance = (inverse @ spread @ inverse)[:3, :3]
    covariance += np.diag(_systematic_rad(pairs[0].rig) ** 2)
    unknown = float("nan")  # until it is known what is believed
    rotation = EyeRotation(fitted[:3], covariance, len(pairs), len(seen.pair), unknown, unknown)
    before_px, after_px = (
        _typical_px(seen.off_px(np.append(turn, 0.0)), seen.pair)
        for turn in (np.zeros(3), rotation.believed_rad)
    )
    return replace(rotation, before_px=before_px, after_px=after_px)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Matches of all pairs as directions.

    Args:
        lines: (N, 3) epipolar line of each in the right eye, as its rig says it.
        right: (N, 3) direction in which the right eye sees it, forward component 1.
        focal_px: (N,) vertical focal length.
        pair: (N,) number of the pair.
        cell: (N,) number of the part of the picture.
    """

    lines: Float64
    right: Float64
    focal_px: Float64
    pair: Int64
    cell: Int64

    @classmethod
    def of(cls, pairs: Sequence[RiggedMatches]) -> _Seen:
        parts = [_directions(pair) for pair in pairs]
        counts = [len(pair.matches) for pair in pairs]
        focal_px = [pair.rig.right.K[1, 1] for pair in pairs]
        return cls(
            np.concatenate([lines for lines, _, _ in parts]),
            np.concatenate([right for _, right, _ in parts]),
            np.repeat(focal_px, counts),
            np.repeat(np.arange(len(pairs)), counts),
            np.concatenate([cell for _, _, cell in parts]),
        )

    def off_px(self, fitted: Float64) -> Float64:
        """(N,) how far below their lines matches lie once the eye is turned back."""
        back = self.right @ exp_twist(np.concatenate([np.zeros(3), -fitted[:3]]))[:3, :3].T
        along = np.einsum("ni,ni->n", self.lines, back) / (self.lines[:, 1] * back[:, 2])
        return np.asarray(self.focal_px * (along - fitted[3] * self.right[:, 1]))


def _directions(pair: RiggedMatches) -> tuple[Float64, Float64, Int64]:
    matches, rig = pair.matches, pair.rig
    ones = np.ones((len(matches), 1))
    left = np.hstack([matches.left_px, ones]) @ np.linalg.inv(rig.left.K).T
    right = np.hstack([matches.right_px, ones]) @ np.linalg.inv(rig.right.K).T
    lines = np.cross(rig.T_right_left.translation_m, left @ rig.T_right_left.matrix[:3, :3].T)
    share = matches.right_px / np.array(matches.size_px)
    column, row = (np.clip(share * CELLS, 0, np.array(CELLS) - 1).astype(np.int64)).T
    return lines, right, row * CELLS[0] + column


def _step(seen: _Seen, fitted: Float64) -> tuple[Float64, Float64, Float64]:
    """One step of weighted least squares, its normal matrix (4, 4) and the scores (N, 4)."""
    off_px = seen.off_px(fitted)
    nudges = DIFFERENCE_RAD * np.eye(4)
    J = np.stack(
        [
            (seen.off_px(fitted + n) - seen.off_px(fitted - n)) / (2 * DIFFERENCE_RAD)
            for n in nudges
        ],
        axis=1,
    )
    noise_px = max(LEAST_NOISE_PX, robust_sigma(off_px))
    weight = 1.0 / (1.0 + (off_px / noise_px) ** 2)
    scores = J * (weight * off_px)[:, None]
    normal = J.T @ (weight[:, None] * J)
    return -np.linalg.pinv(normal) @ scores.sum(axis=0), normal, scores


def _spread(scores: Float64, cluster: Int64) -> Float64:
    """(4, 4) sum of squares of what errors that go together add up to."""
    names, number = np.unique(cluster, return_inverse=True)
    sums = np.stack([np.bincount(number, weights=scores[:, k]) for k in range(4)], axis=1)
    if len(names) < 2:
        return np.zeros((4, 4))
    return np.asarray(sums.T @ sums * len(names) / (len(names) - 1))


def _systematic_rad(rig: StereoRig) -> Float64:
    """(3,) turns that look like what no number of matches averages out."""
    K, (width, height) = rig.right.K, rig.right.size_px
    x, y = width / 2 / K[0, 0], height / 2 / K[1, 1]
    return np.asarray([TOGETHER_PX, LENS_PX / (x * y), TOGETHER_PX / x] / K[1, 1])


def _typical_px(off_px: Float64, pair: Int64) -> float:
    medians = [np.median(np.abs(off_px[pair == number])) for number in np.unique(pair)]
    return float(np.median(medians))
