"""How two cameras stand to each other, from matches of their pictures alone; up to scale.

Both cameras are turned until rows correspond: the left one about y and z, the right one about x, y
and z, with one focal length and the centre of the picture for both. These five angles are the
essential matrix, of which they are the minimal form: what is left of it once rows correspond is
known. Without a focal length one is assumed: of eyes that look about the same way every focal
length explains the rows as well (KITTI, Middlebury, rendered rooms: 0.12, 0.08, 0.03 px from 300 to
2500 px). Another one is taken where it predicts matches clearly better that it was not fitted to.

The scene is then known up to its scale, as far as the focal length is known; else up to a
projectivity, that is, with planes and straight lines, and without angles and ratios. Of the five
angles the yaws are known worst: an error of one adds an offset to all disparities. Where that would
put things behind infinity, the centre of the right picture, which is not known either, is moved.

Source: Fusiello and Irsara 2008, quasi-Euclidean epipolar rectification; Sampson's distance by
Hartley & Zisserman, equation 11.9. Hartley's own method (there, 11.12) has the same row error, and
shears the pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pseudolidar.calibration.check_matches import PairMatches
from pseudolidar.errors import CalibrationValue, PairSwapped
from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import LEFT_FRAME, RIGHT_FRAME, Camera, StereoRig
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M
from pseudolidar.structures.pose import Pose

FocalFrom = Literal["given", "assumed", "seen"]
# Matches without which nothing is said, and the share of them that must agree.
LEAST_MATCHES, LEAST_SHARE = 60, 0.25
# Focal length that is assumed, in picture widths: a view of 58 degrees; and those that are tried
# beside it, which must explain left-out matches better by this.
ASSUMED_WIDTHS, TRIED_RATIOS, LEAST_GAIN = 0.9, (0.5, 0.7, 1.4, 2.0), 0.1
# Matches farther from their epipolar line are wrong, px; noise at which the Cauchy loss bends.
WRONG_PX, NOISE_PX = 1.0, 0.3
# Cameras turned by more than this are not side by side, degrees.
MOST_TURNED_DEG = 40.0
# Rows farther apart than this, of so many of the matches, px: no rectification was found.
MOST_ROWS_PX = 1.0
ROWS_SHARE = 0.68
# Disparity that the farthest matches have at least, px: at infinity and behind it is no point. The
# centre is moved so often at most, or until no more than this share of it is missing.
LEAST_FAR_PX, FAR_QUANTILE, MOST_MOVES, MISSING_SHARE = 1.0, 0.01, 5, 0.1
# Size of the angles that are usual, rad: the solver's unit.
USUAL_RAD = 0.01
# How far the nearest matches are, in the rig's unit.
NEAREST_UNITS = 1.25 * DEFAULT_MIN_DEPTH_M
# Matches lie in clumps that err alike.
CLUMP = 3.0
CONFIDENCE, MOST_SAMPLES, SEED = 0.999, 10_000, 0


@dataclass(frozen=True, eq=False)
class UncalibratedFit:
    """Two cameras as their pictures show them.

    Args:
        rig: cameras without distortion; its scale is unknown. Its unit of length is such that the
            nearest matches are a little farther than the nearest depth that is usually looked for,
            so that what is usual for metres fits it.
        focal_from: where the focal length is from.
        pairs: how many pairs it is from.
        matches: of them.
        agreeing: how many of these agree.
        before_px: row difference of the pictures as they are, median.
        after_px: the same rectified.
        held_px: the same of matches that were left out of the fit.
        yaw_sigma_px: what an error of the yaw, one standard deviation, adds to all disparities.
        far_px: disparity of the farthest matches.
        moved_px: by how much the centre of the right picture was moved so that it is above 0.
    """

    rig: StereoRig
    focal_from: FocalFrom
    pairs: int
    matches: int
    agreeing: int
    before_px: float
    after_px: float
    held_px: float
    yaw_sigma_px: float
    far_px: float
    moved_px: float


def fit_uncalibrated(
    pairs: Sequence[PairMatches], *, focal_px: float | None = None
) -> UncalibratedFit:
    """Find how the cameras of some pairs stand to each other.

    Args:
        pairs: matches of pairs of the same two cameras, of one size.
        focal_px: focal length of both, where it is known.

    Raises:
        CalibrationValue: too few matches agree, the cameras do not stand side by side, or what is
            seen leaves their places open.
        PairSwapped: the left camera stands on the right.
    """
    size_px = pairs[0].size_px
    left = np.concatenate([matches.left_px for matches in pairs])
    right = np.concatenate([matches.right_px for matches in pairs])
    agree = _agreeing(left, right)
    a, b = left[agree], right[agree]
    solver, focal_from = _Solver.chosen(a, b, size_px, focal_px)
    moved_px = 0.0
    for _ in range(MOST_MOVES):
        found = solver.solved(a, b)
        flat = solver.rectified(found.angles, a, b)
        _check(found.angles, flat)
        short_px = LEAST_FAR_PX - flat.far_px
        if short_px < MISSING_SHARE * LEAST_FAR_PX:
            break
        moved_px += short_px
        solver = solver.moved(short_px)
    return UncalibratedFit(
        solver.rig(found.angles, size_px, flat),
        focal_from,
        len(pairs),
        len(left),
        len(a),
        float(np.median(np.abs(right[:, 1] - left[:, 1]))),
        float(np.median(flat.rows_px)),
        solver.held_px(a, b),
        found.yaw_sigma_rad * float(solver.K_left[0, 0]),
        flat.far_px,
        moved_px,
    )


@dataclass(frozen=True, eq=False)
class _Found:
    """(5,) angles, rad, and the standard deviation of the difference of the yaws."""

    angles: Float64
    yaw_sigma_rad: float


@dataclass(frozen=True, eq=False)
class _Flat:
    """(N,) row differences and disparities of matches in the rectified pictures, px."""

    rows_px: Float64
    disparity: Float64

    @property
    def far_px(self) -> float:
        return float(np.quantile(self.disparity, FAR_QUANTILE))

    @property
    def near_px(self) -> float:
        return float(np.quantile(self.disparity, 1 - FAR_QUANTILE))


@dataclass(frozen=True, eq=False)
class _Solver:
    """Finds the angles for one focal length.

    Args:
        K_left: (3, 3) of the left camera, and of both rectified pictures.
        K_right: (3, 3) of the right one.
    """

    K_left: Float64
    K_right: Float64

    @classmethod
    def of(cls, focal_px: float, size_px: tuple[int, int]) -> _Solver:
        width, height = size_px
        centre = (width - 1) / 2, (height - 1) / 2
        K = np.array([[focal_px, 0, centre[0]], [0, focal_px, centre[1]], [0, 0, 1.0]])
        return cls(K, K)

    def moved(self, px: float) -> _Solver:
        """With the centre of the right picture so far to the right: disparities grow by it."""
        K_right = self.K_right.copy()
        K_right[0, 2] += px
        return replace(self, K_right=K_right)

    @classmethod
    def chosen(
        cls, a: Float64, b: Float64, size_px: tuple[int, int], focal_px: float | None
    ) -> tuple[_Solver, FocalFrom]:
        """With the focal length that is given, else the assumed one unless another is better."""
        if focal_px is not None:
            return cls.of(focal_px, size_px), "given"
        assumed_px = ASSUMED_WIDTHS * size_px[0]
        assumed = cls.of(assumed_px, size_px)
        others = [cls.of(ratio * assumed_px, size_px) for ratio in TRIED_RATIOS]
        best = min(others, key=lambda other: other.held_cost(a, b))
        if best.held_cost(a, b) < (1 - LEAST_GAIN) * assumed.held_cost(a, b):
            return best, "seen"
        return assumed, "assumed"

    def solved(self, a: Float64, b: Float64) -> _Found:
        """The most likely angles where errors are Cauchy-distributed."""
        from scipy.optimize import least_squares

        found = least_squares(
            self.off_px,
            np.zeros(5),
            args=(a, b),
            loss="cauchy",
            f_scale=NOISE_PX,
            x_scale=np.full(5, USUAL_RAD),
        )
        noise_px = robust_sigma(found.fun)
        J = np.asarray(found.jac, np.float64)
        covariance = np.linalg.pinv(J.T @ J) * noise_px**2 * CLUMP
        differ = np.array([-1.0, 0, 0, 1, 0])
        return _Found(found.x, float(np.sqrt(differ @ covariance @ differ)))

    def homographies(self, angles: Float64) -> tuple[Float64, Float64]:
        """(3, 3) from pixels to those of the rectified pictures."""
        R_left, R_right = _rotations(angles)
        K = self.K_left
        return K @ R_left @ np.linalg.inv(K), K @ R_right @ np.linalg.inv(self.K_right)

    def rectified(self, angles: Float64, a: Float64, b: Float64) -> _Flat:
        """What matches are in the rectified pictures."""
        H_left, H_right = self.homographies(angles)
        left, right = _mapped(H_left, a), _mapped(H_right, b)
        return _Flat(np.abs(right[:, 1] - left[:, 1]), left[:, 0] - right[:, 0])

    def rig(self, angles: Float64, size_px: tuple[int, int], flat: _Flat) -> StereoRig:
        """The cameras as they are mounted, so that these rotations rectify them."""
        width, height = size_px
        R_left, R_right = _rotations(angles)
        apart = NEAREST_UNITS * flat.near_px / self.K_left[0, 0]
        t = R_right.T @ np.array([-apart, 0.0, 0.0])
        return StereoRig(
            Camera(self.K_left, width, height, frame=LEFT_FRAME),
            Camera(self.K_right, width, height, frame=RIGHT_FRAME),
            Pose.from_rotation(RIGHT_FRAME, LEFT_FRAME, R_right.T @ R_left, t),
            metric=False,
        )

    def off_px(self, angles: Float64, a: Float64, b: Float64) -> Float64:
        """(N,) signed distance of matches from their epipolar lines, to first order."""
        H_left, H_right = self.homographies(angles)
        same_row = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        F = H_right.T @ same_row @ H_left
        ones = np.ones((len(a), 1))
        at_left, at_right = np.hstack([a, ones]), np.hstack([b, ones])
        lines, lines_left = at_left @ F.T, at_right @ F
        slope = np.sqrt((lines[:, :2] ** 2 + lines_left[:, :2] ** 2).sum(axis=1))
        return np.asarray((at_right * lines).sum(axis=1) / np.maximum(slope, 1e-12))

    def held(self, a: Float64, b: Float64) -> Float64:
        """(N,) distances of matches from lines that were fitted to the other half."""
        off = np.empty(len(a))
        half = np.arange(len(a)) % 2 == 0
        for held in (half, ~half):
            off[held] = self.off_px(self.solved(a[~held], b[~held]).angles, a[held], b[held])
        return off

    def held_cost(self, a: Float64, b: Float64) -> float:
        """Mean Cauchy loss of these, px^2."""
        return float(np.mean(np.log1p((self.held(a, b) / NOISE_PX) ** 2)) * NOISE_PX**2)

    def held_px(self, a: Float64, b: Float64) -> float:
        """Median row difference that these are: distances hold an equal part of both pictures."""
        return float(np.median(np.abs(self.held(a, b))) * np.sqrt(2))


def _agreeing(left: Float64, right: Float64) -> Bool:
    """(N,) matches that one fundamental matrix explains.

    Raises:
        CalibrationValue: too few.
    """
    import cv2

    agree = np.zeros(len(left), np.bool_)
    if len(left) >= LEAST_MATCHES:
        cv2.setRNGSeed(SEED)
        _, mask = cv2.findFundamentalMat(
            left, right, cv2.USAC_MAGSAC, WRONG_PX, CONFIDENCE, MOST_SAMPLES
        )
        agree = agree if mask is None else np.asarray(mask).ravel() > 0
    if agree.sum() < max(LEAST_MATCHES, LEAST_SHARE * len(left)):
        raise CalibrationValue(
            f"{int(agree.sum())} of {len(left)} matches agree on how the cameras stand",
            want=f"{LEAST_MATCHES} or more, and {LEAST_SHARE:.0%} of them",
            fix="Give more pairs, of a scene with structure near and far; or calibrate with a "
            "board, `pseudolidar calibrate`.",
        )
    return agree


def _rotations(angles: Float64) -> tuple[Float64, Float64]:
    """Rotations of the left and the right camera that make rows correspond."""
    left, right = np.zeros(6), np.zeros(6)
    left[4:], right[3:] = angles[:2], angles[2:]
    return exp_twist(left)[:3, :3], exp_twist(right)[:3, :3]


def _mapped(H: Float64, px: Float64) -> Float64:
    """(N, 2) pixels after a homography."""
    seen = np.hstack([px, np.ones((len(px), 1))]) @ H.T
    return np.asarray(seen[:, :2] / seen[:, 2:])


def _check(angles: Float64, flat: _Flat) -> None:
    turned_deg = float(np.degrees(np.abs(angles).max()))
    rows = float(np.quantile(flat.rows_px, ROWS_SHARE))
    if turned_deg > MOST_TURNED_DEG or not rows < MOST_ROWS_PX:
        raise CalibrationValue(
            f"cameras turned by {turned_deg:.0f} degrees, rows of {100 * ROWS_SHARE:.0f} % within "
            f"{rows:.2f} px",
            want=f"cameras side by side, turned by less than {MOST_TURNED_DEG:.0f} degrees",
            fix="Are these pictures of two cameras side by side, and is the focal length right? "
            "Strong lens distortion needs a calibration.",
        )
    if np.median(flat.disparity) < 0:
        raise PairSwapped(
            "most things are seen farther right in the right picture",
            want="the left eye's picture on the left",
            fix="Pass --swap.",
        )
