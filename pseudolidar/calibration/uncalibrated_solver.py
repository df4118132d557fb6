"""The five angles by which rows of two pictures correspond, for one focal length."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pseudolidar.geometry.robust import robust_sigma
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.camera import LEFT_FRAME, RIGHT_FRAME, Camera, StereoRig
from pseudolidar.structures.disparity import DEFAULT_MIN_DEPTH_M
from pseudolidar.structures.pose import Pose

FocalFrom = Literal["given", "assumed", "seen"]
# Focal length that is assumed, in picture widths: a view of 58 degrees; and those that are tried
# beside it, which must explain left-out matches better by this.
ASSUMED_WIDTHS, TRIED_RATIOS, LEAST_GAIN = 0.9, (0.5, 0.7, 1.4, 2.0), 0.1
# Noise at which the Cauchy loss bends, px.
NOISE_PX = 0.3
# The farthest matches are those of this share.
FAR_QUANTILE = 0.01
# Size of the angles that are usual, rad: the solver's unit.
USUAL_RAD = 0.01
# How far the nearest matches are, in the rig's unit.
NEAREST_UNITS = 1.25 * DEFAULT_MIN_DEPTH_M
# Matches lie in clumps that err alike.
CLUMP = 3.0


@dataclass(frozen=True, eq=False)
class FoundAngles:
    """How two cameras are turned to make rows correspond.

    Args:
        angles: (5,) rad, about y and z of the left camera, about x, y and z of the right one.
        yaw_sigma_rad: standard deviation of the difference of the angles about y.
    """

    angles: Float64
    yaw_sigma_rad: float


@dataclass(frozen=True, eq=False)
class FlatMatches:
    """What matches are in the rectified pictures.

    Args:
        rows_px: (N,) row differences, >= 0.
        disparity: (N,) px.
    """

    rows_px: Float64
    disparity: Float64

    @property
    def far_px(self) -> float:
        """Disparity of the farthest matches."""
        return float(np.quantile(self.disparity, FAR_QUANTILE))

    @property
    def near_px(self) -> float:
        """Disparity of the nearest ones."""
        return float(np.quantile(self.disparity, 1 - FAR_QUANTILE))


@dataclass(frozen=True, eq=False)
class Solver:
    """Finds the angles for one focal length.

    Args:
        K_left: (3, 3) of the left camera, and of both rectified pictures.
        K_right: (3, 3) of the right one.
    """

    K_left: Float64
    K_right: Float64

    @classmethod
    def of(cls, focal_px: float, size_px: tuple[int, int]) -> Solver:
        """With one focal length, and the centre of the picture, for both eyes."""
        width, height = size_px
        centre = (width - 1) / 2, (height - 1) / 2
        K = np.array([[focal_px, 0, centre[0]], [0, focal_px, centre[1]], [0, 0, 1.0]])
        return cls(K, K)

    def moved(self, px: float) -> Solver:
        """With the centre of the right picture so far to the right: disparities grow by it."""
        K_right = self.K_right.copy()
        K_right[0, 2] += px
        return replace(self, K_right=K_right)

    @classmethod
    def chosen(
        cls, a: Float64, b: Float64, size_px: tuple[int, int], focal_px: float | None
    ) -> tuple[Solver, FocalFrom]:
        """With the focal length that is given, else the assumed one unless another is better."""
        if focal_px is not None:
            return cls.of(focal_px, size_px), "given"
        assumed_px = ASSUMED_WIDTHS * size_px[0]
        assumed = cls.of(assumed_px, size_px)
        others = [cls.of(ratio * assumed_px, size_px) for ratio in TRIED_RATIOS]
        costs = [other.held_cost(a, b) for other in others]
        best = int(np.argmin(costs))
        if costs[best] < (1 - LEAST_GAIN) * assumed.held_cost(a, b):
            return others[best], "seen"
        return assumed, "assumed"

    def solved(self, a: Float64, b: Float64) -> FoundAngles:
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
        return FoundAngles(found.x, float(np.sqrt(differ @ covariance @ differ)))

    def homographies(self, angles: Float64) -> tuple[Float64, Float64]:
        """(3, 3) from pixels to those of the rectified pictures."""
        R_left, R_right = _rotations(angles)
        K = self.K_left
        return K @ R_left @ np.linalg.inv(K), K @ R_right @ np.linalg.inv(self.K_right)

    def rectified(self, angles: Float64, a: Float64, b: Float64) -> FlatMatches:
        """What matches are in the rectified pictures."""
        H_left, H_right = self.homographies(angles)
        left, right = _mapped(H_left, a), _mapped(H_right, b)
        return FlatMatches(np.abs(right[:, 1] - left[:, 1]), left[:, 0] - right[:, 0])

    def rig(self, angles: Float64, size_px: tuple[int, int], flat: FlatMatches) -> StereoRig:
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


def _rotations(angles: Float64) -> tuple[Float64, Float64]:
    """Rotations of the left and the right camera that make rows correspond."""
    left, right = np.zeros(6), np.zeros(6)
    left[4:], right[3:] = angles[:2], angles[2:]
    return exp_twist(left)[:3, :3], exp_twist(right)[:3, :3]


def _mapped(H: Float64, px: Float64) -> Float64:
    """(N, 2) pixels after a homography."""
    seen = np.hstack([px, np.ones((len(px), 1))]) @ H.T
    return np.asarray(seen[:, :2] / seen[:, 2:])
