"""Cameras, the stereo rig, and the smooth correction of its disparities."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pseudolidar.errors import (
    CalibrationSizeMismatch,
    CalibrationUnits,
    CalibrationValue,
    NotRectified,
)
from pseudolidar.structures.arrays import Float64, check_array
from pseudolidar.structures.correction import DisparityCorrection, RowCorrection, SigmaScale
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.quality import CalibrationQuality

LensModel = Literal["pinhole", "fisheye"]
# Frames of the cameras of a rig, in files and wherever a rig is made.
LEFT_FRAME, RIGHT_FRAME = "camera_left", "camera_right"
# Systematic disparity error of a rig whose calibration nobody checked, px (measured on KITTI: about
# 0.5 px at range).
UNREFINED_SIGMA_PX = 0.5
# A rectified pair: rotations and (relative) focal lengths agree to the 7 digits of text files.
RECTIFIED_TOLERANCE = 1e-6
# Its rows agree to this, px: far below what a matcher could see.
RECTIFIED_ROWS_PX = 1e-3
# Residual of the right centre off the baseline direction that published rectified rigs carry
# (KITTI: 0.5 %).
RECTIFIED_OFF_AXIS = 0.02


# A side of a picture has at most so many pixels; a focal length is that many widths at most, and
# one of them in as many at least; and no lens model has such a coefficient.
LARGEST_SIDE_PX, LARGEST_FOCAL, LARGEST_COEFFICIENT = 1_000_000, 1e6, 1e9


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated camera.

    Args:
        K: (3, 3) float64 intrinsic matrix, px; first pixel centre at (0, 0).
        width_px: image width.
        height_px: image height.
        distortion: (n,) float64 coefficients of `model`, empty for a rectified camera.
        model: lens model of `distortion`.
        frame: name of the optical frame (x right, y down, z forward).

    Raises:
        CalibrationValue: size, focal length, principal point or distortion impossible.
    """

    K: Float64
    width_px: int
    height_px: int
    distortion: Float64 = field(default_factory=lambda: np.zeros(0))
    model: LensModel = "pinhole"
    frame: str = LEFT_FRAME

    def __post_init__(self) -> None:
        check_array("Camera", "K", self.K, (3, 3), np.float64)
        check_array("Camera", "distortion", self.distortion, (None,), np.float64)
        self._check_size()
        fx, fy = self.K[0, 0], self.K[1, 1]
        if not (np.isfinite(self.K).all() and fx > 0 and fy > 0):
            raise CalibrationValue(
                f"focal lengths {fx:g}, {fy:g} px", want="positive", where=f"{self.frame}.K"
            )
        widths = np.array([fx, fy]) / self.width_px
        if widths.max() > LARGEST_FOCAL or widths.min() < 1 / LARGEST_FOCAL:
            raise CalibrationValue(
                f"focal lengths {fx:g}, {fy:g} px of pictures {self.width_px} px wide",
                want="lengths in pixels",
                where=f"{self.frame}.K",
            )
        cx, cy = self.K[0, 2], self.K[1, 2]
        if not (0 <= cx < self.width_px and 0 <= cy < self.height_px):
            raise CalibrationValue(
                f"principal point ({cx:g}, {cy:g}) px",
                want=f"inside the image of {self.width_px}x{self.height_px}",
                fix="Check that calibration and images have the same size.",
                where=f"{self.frame}.K",
            )

        if not (np.abs(self.distortion) <= LARGEST_COEFFICIENT).all():
            raise CalibrationValue(
                f"distortion {self.distortion.tolist()}",
                want="numbers of a lens",
                where=f"{self.frame}.distortion",
            )

    def _check_size(self) -> None:
        if not 1 <= min(self.size_px) <= max(self.size_px) <= LARGEST_SIDE_PX:
            raise CalibrationValue(
                f"pictures of {self.width_px:g}x{self.height_px:g} px",
                want=f"sides of 1 to {LARGEST_SIDE_PX} px",
                where=f"{self.frame}.size_px",
            )

    @property
    def focal_px(self) -> float:
        """Horizontal focal length, px."""
        return float(self.K[0, 0])

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.width_px, self.height_px

    def check_size(self, width_px: int, height_px: int) -> None:
        """Raise `CalibrationSizeMismatch` unless images of this size belong to the camera."""
        if (width_px, height_px) != self.size_px:
            raise CalibrationSizeMismatch(
                f"images of {width_px}x{height_px}",
                want=f"{self.width_px}x{self.height_px}, the size of the calibration",
                fix="Pass --scale-calibration if the images were resized, or the right rig.",
            )


@dataclass(frozen=True, eq=False)
class StereoRig:
    """A calibrated stereo pair and what is mounted with it.

    Args:
        left: left camera.
        right: right camera.
        T_right_left: pose of the left camera in the right one.
        T_left_velodyne: where a Velodyne is calibrated to the left camera.
        T_velodyne_imu: where an IMU is calibrated to the Velodyne.
        correction: systematic disparity error to take off, applied in reprojection and nowhere
            else.
        rows: difference of rows that rectification left in the pictures. Sources put it right as
            they load a pair; the rig of such a frame has none.
        origin: where the calibration comes from, in words.
        quality: how good the calibration is, where it tells.
        lidar_pitch_rad: by how much the calibration of a LiDAR to the left camera places its scans
            pitched down too far. Sources with this rig raise their LiDAR by it; `T_left_velodyne`
            of this rig is raised already.
        metric: whether lengths are metres. Those of a rig found from pictures alone, and of all
            that is measured with it, are in a unit that nobody knows.

    Raises:
        CalibrationValue: baseline zero or of the wrong sign.
    """

    left: Camera
    right: Camera
    T_right_left: Pose
    T_left_velodyne: Pose | None = None
    T_velodyne_imu: Pose | None = None
    correction: DisparityCorrection | None = None
    origin: str = ""
    rows: RowCorrection | None = None
    quality: CalibrationQuality | None = None
    metric: bool = True
    lidar_pitch_rad: float = 0.0

    def __post_init__(self) -> None:
        t_m = self.T_right_left.translation_m
        if not np.linalg.norm(t_m) > 0:
            raise CalibrationValue("baseline 0 m", want="two cameras apart", where="T_right_left")
        if self.rectified_rotation and t_m[0] > 0:
            raise CalibrationValue(
                f"baseline {-t_m[0]:g} m: the camera called left stands right of the other",
                want="a positive baseline",
                fix="Exchange the two cameras, or pass the pair in the order left, right.",
                where="T_right_left",
            )

    @property
    def rectified_rotation(self) -> bool:
        """Whether both cameras look in the same direction."""
        R = self.T_right_left.matrix[:3, :3]
        return bool(np.abs(R - np.eye(3)).max() < RECTIFIED_TOLERANCE)

    @property
    def is_rectified(self) -> bool:
        """Whether rows of the two images correspond; pixels need not be square."""
        K, K_right = self.left.K, self.right.K
        same_rows = abs(K[1, 2] - K_right[1, 2]) < RECTIFIED_ROWS_PX
        ratios = np.array([K[0, 0] / K_right[0, 0], K[1, 1] / K_right[1, 1]])
        same_focal = np.abs(ratios - 1).max() < RECTIFIED_TOLERANCE
        no_skew = K[0, 1] == 0 and K_right[0, 1] == 0
        t_m = np.abs(self.T_right_left.translation_m)
        along_row = max(t_m[1], t_m[2]) <= RECTIFIED_OFF_AXIS * t_m[0]
        undistorted = not (self.left.distortion.any() or self.right.distortion.any())
        flat = self.left.model == self.right.model == "pinhole"
        return bool(
            self.rectified_rotation
            and self.left.size_px == self.right.size_px
            and flat
            and same_rows
            and same_focal
            and no_skew
            and along_row
            and undistorted
        )

    @property
    def baseline_m(self) -> float:
        """Distance of the optical centres along the rows, `-P_right[0, 3] / f`, metres."""
        return float(-self.P_right[0, 3] / self.left.focal_px)

    @property
    def baseline_text(self) -> str:
        """The baseline for people; no metres where there are none."""
        if not self.metric:
            return f"baseline {self.baseline_m:.4g} of unknown scale"
        return f"baseline {self.baseline_m:.5f} m"

    def check_metric(self) -> None:
        """Raise `CalibrationUnits` where lengths are no metres."""
        if not self.metric:
            raise CalibrationUnits(
                "a rig of unknown scale: its lengths are in a unit that nobody knows",
                want="metres",
                fix="Set the scale by something known, `pseudolidar rectify SOURCE OUT "
                "--uncalibrated --known-distance baseline:0.12`.",
                where="metric",
            )

    @property
    def doffs_px(self) -> float:
        """`cx_right - cx_left`: disparity of a point at infinity is `-doffs_px`."""
        return float(self.right.K[0, 2] - self.left.K[0, 2])

    @property
    def fB_px_m(self) -> float:
        """Focal length times baseline: depth at a disparity of one pixel (with doffs 0)."""
        return self.left.focal_px * self.baseline_m

    @property
    def P_left(self) -> Float64:
        """(3, 4) projection of points in the left camera's frame into the left image."""
        return np.hstack([self.left.K, np.zeros((3, 1))])

    @property
    def P_right(self) -> Float64:
        """(3, 4) projection of points in the left camera's frame into the right image."""
        return np.asarray(self.right.K @ self.T_right_left.matrix[:3], dtype=np.float64)

    @property
    def Q(self) -> Float64:
        """(4, 4): `Q (u, v, d, 1) ~ (X, Y, Z, 1)` in the left camera's frame, d > 0.

        Raises:
            NotRectified: rows of the pair do not correspond.

        Source: OpenCV stereoRectify, with d = x_left - x_right positive.
        """
        if not self.is_rectified:
            raise NotRectified("the rig is not rectified", want="aligned rows", fix="Rectify it.")
        K, B = self.left.K, self.baseline_m
        f, ratio = K[0, 0], K[0, 0] / K[1, 1]
        return np.array(
            [
                [1.0, 0.0, 0.0, -K[0, 2]],
                [0.0, ratio, 0.0, -K[1, 2] * ratio],
                [0.0, 0.0, 0.0, f],
                [0.0, 0.0, 1.0 / B, self.doffs_px / B],
            ]
        )

    @property
    def systematic_sigma_px(self) -> float:
        """Systematic disparity error inside every sigma: unrefined 0.5 px, refined its residual."""
        return UNREFINED_SIGMA_PX if self.correction is None else self.correction.residual_px

    @property
    def sigma_scale(self) -> SigmaScale:
        """Factor on the matcher's sigma that the rig's refinement found; 1 unrefined."""
        return SigmaScale() if self.correction is None else self.correction.sigma_scale

    def with_correction(self, correction: DisparityCorrection | None) -> StereoRig:
        """The same rig with another disparity correction."""
        return replace(self, correction=correction)

    def with_lidar_raised(self, pitch_rad: float) -> StereoRig:
        """The same rig with its LiDAR, if there is one, pitched up by so much more."""
        T_left_velodyne = self.T_left_velodyne and raised(self.T_left_velodyne, pitch_rad)
        pitch_rad += self.lidar_pitch_rad
        return replace(self, T_left_velodyne=T_left_velodyne, lidar_pitch_rad=pitch_rad)

    def lidar_of(self, own: StereoRig) -> Pose | None:
        """`T_left_velodyne` on a source whose own rig is `own`: its LiDAR raised, or this."""
        if own.T_left_velodyne is None:
            return self.T_left_velodyne
        return raised(own.T_left_velodyne, self.lidar_pitch_rad)

    def with_rows(self, rows: RowCorrection | None) -> StereoRig:
        """The same rig with another row correction."""
        return replace(self, rows=rows)

    def check_size(self, width_px: int, height_px: int) -> None:
        """Raise `CalibrationSizeMismatch` unless images of this size belong to the rig."""
        self.left.check_size(width_px, height_px)

    def check_sizes(self, left_px: tuple[int, int], right_px: tuple[int, int]) -> None:
        """Raise `CalibrationSizeMismatch` unless images of these sizes belong to the two eyes."""
        self.left.check_size(*left_px)
        self.right.check_size(*right_px)

    def scaled_to(self, width_px: int, height_px: int) -> StereoRig:
        """The rig for images resized to (width_px, height_px), pixel centres at integers.

        A right camera of another size is resized by the same ratios.
        """
        x_ratio, y_ratio = width_px / self.left.width_px, height_px / self.left.height_px
        right_px = round(self.right.width_px * x_ratio), round(self.right.height_px * y_ratio)
        return replace(
            self,
            left=_scaled(self.left, width_px, height_px),
            right=_scaled(self.right, *right_px),
            correction=self.correction and self.correction.scaled(x_ratio),
            rows=self.rows and self.rows.scaled(y_ratio),
            quality=self.quality and self.quality.scaled(x_ratio, y_ratio),
        )


def raised(T_left_lidar: Pose, pitch_rad: float) -> Pose:
    """The pose with everything turned up about the left camera's x axis."""
    if not pitch_rad:
        return T_left_lidar
    c, s = np.cos(pitch_rad), np.sin(pitch_rad)
    up = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    left = T_left_lidar.dst
    return Pose.from_rotation(left, left, up, np.zeros(3)) @ T_left_lidar


def _scaled(camera: Camera, width_px: int, height_px: int) -> Camera:
    sx, sy = width_px / camera.width_px, height_px / camera.height_px
    # A pixel centre u becomes (u + 0.5) s - 0.5.
    scale = np.array([[sx, 0, 0.5 * sx - 0.5], [0, sy, 0.5 * sy - 0.5], [0, 0, 1.0]])
    return replace(camera, K=scale @ camera.K, width_px=width_px, height_px=height_px)
