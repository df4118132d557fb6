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
from dataclasses import dataclass

import numpy as np

from pseudolidar.calibration.check_matches import PairMatches
from pseudolidar.calibration.uncalibrated_solver import FlatMatches, FocalFrom, Solver
from pseudolidar.errors import CalibrationValue, PairSwapped
from pseudolidar.structures.arrays import Bool, Float64
from pseudolidar.structures.camera import StereoRig

# Matches without which nothing is said, and the share of them that must agree.
LEAST_MATCHES, LEAST_SHARE = 60, 0.25
# Matches farther from their epipolar line are wrong, px.
WRONG_PX = 1.0
# Cameras turned by more than this are not side by side, degrees.
MOST_TURNED_DEG = 40.0
# Rows farther apart than this, of so many of the matches, px: no rectification was found.
MOST_ROWS_PX = 1.0
ROWS_SHARE = 0.68
# What centres off the middle, lens distortion and the yaw, which rows hardly tell, add to all
# disparities of real pairs, as a share of the width: KITTI unrectified 0.030 (41 px, against the
# Velodyne), Middlebury's motorcycle 0.042 (31 px), the pinhole chessboards 0.042. 2026-11-26.
OFFSET_SHARE = 0.03
# Disparity that the farthest matches have at least, px: at infinity and behind it is no point. The
# centre is moved so often at most, or until no more than this share of it is missing.
LEAST_FAR_PX, MOST_MOVES, MISSING_SHARE = 1.0, 5, 0.1
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

    @property
    def offset_sigma_px(self) -> float:
        """What all disparities may be too large or too small by, one standard deviation.

        Matches tell only what the error of the yaw makes of it; centres and lenses add more.
        """
        return float(np.hypot(self.yaw_sigma_px, OFFSET_SHARE * self.rig.left.width_px))


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
    solver, focal_from = Solver.chosen(a, b, size_px, focal_px)
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


def _check(angles: Float64, flat: FlatMatches) -> None:
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
