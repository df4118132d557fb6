"""What a source yields: raw pairs, rectified pairs, and scans that come with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import NotRectified, PairMismatch, StructureError
from pseudolidar.structures.arrays import (
    AnyArray,
    Bool,
    Float32,
    Image,
    Int64,
    check_array,
    size_of,
)
from pseudolidar.structures.box import Label
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class LidarScan:
    """One turn of a LiDAR, not motion-compensated unless said.

    Args:
        xyz: (N, 3) float32 m, finite.
        reflectance: (N,) float32 0-1, or None.
        timestamp_ns: time of the scan.
        frame: coordinate frame.
        point_times_ns: (N,) int64 per-point times, or None.
        turn_ns: when the turn began and ended, where only that is known.
        dropped: points of the file that were not finite or beyond any range, and left out.
    """

    xyz: Float32
    reflectance: Float32 | None = None
    timestamp_ns: int = 0
    frame: str = "velodyne"
    point_times_ns: Int64 | None = None
    dropped: int = 0
    turn_ns: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        check_array("LidarScan", "xyz", self.xyz, (None, 3), np.float32)
        n = len(self.xyz)
        if self.reflectance is not None:
            check_array("LidarScan", "reflectance", self.reflectance, (n,), np.float32)
        if self.point_times_ns is not None:
            check_array("LidarScan", "point_times_ns", self.point_times_ns, (n,), np.int64)

    def __len__(self) -> int:
        return len(self.xyz)


def _check_image(owner: str, name: str, image: AnyArray) -> None:
    shape = (None, None, 3) if image.ndim == 3 else (None, None)
    check_array(owner, name, image, shape, np.uint8, np.uint16)


def _check_pair(owner: str, left: AnyArray, right: AnyArray, *, same_size: bool) -> None:
    _check_image(owner, "left", left)
    _check_image(owner, "right", right)
    kinds = [image.shape[0 if same_size else 2 :] for image in (left, right)]
    if kinds[0] != kinds[1] or left.dtype != right.dtype:

        def described(image: AnyArray) -> str:
            channels = 1 if image.ndim == 2 else image.shape[2]
            return f"{image.shape[1]}x{image.shape[0]}, {channels} channel(s), {image.dtype}"

        raise PairMismatch(
            f"left {described(left)}; right {described(right)}",
            want=f"the same {'size, ' if same_size else ''}channels and depth",
            fix="Check that both images belong to the same moment and camera mode.",
        )


@dataclass(frozen=True, eq=False)
class RawPair:
    """An unrectified pair with what its source knows about it.

    What is known by the pixel of a rectified picture (labels, ground truth) it cannot have.

    Args:
        left: (H, W) grey or (H, W, 3) RGB, uint8 or uint16.
        right: like left; of its own size.
        rig: the cameras with their distortion, each of its image's size.
        id: the source's name of the frame.
        index: position in the source.
        timestamp_ns: time of the picture.
        scan: LiDAR scan of the same moment.
        pose: ground truth `T_map_base_link`; `base_link` is that of the unrectified rig.
        motion: of `base_link`, as an IMU measured it.
        notes: what was odd about it, for the report.

    Raises:
        PairMismatch: left and right differ in channels or depth.
        CalibrationSizeMismatch: a camera was calibrated for another image size.
    """

    left: Image
    right: Image
    rig: StereoRig
    id: str
    index: int
    timestamp_ns: int
    scan: LidarScan | None = None
    pose: Pose | None = None
    motion: BodyMotion | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_pair("RawPair", self.left, self.right, same_size=False)
        self.rig.check_sizes(size_of(self.left), size_of(self.right))


@dataclass(frozen=True, eq=False)
class PairMask:
    """Which pixels of a rectified pair show something.

    Args:
        left: (H, W) bool of the left picture.
        right: (H, W) bool of the right one.
    """

    left: Bool
    right: Bool

    def __post_init__(self) -> None:
        check_array("PairMask", "left", self.left, (None, None), np.bool_)
        check_array("PairMask", "right", self.right, self.left.shape, np.bool_)


@dataclass(frozen=True, eq=False)
class StereoFrame:
    """A rectified pair with what its source knows about it.

    Args:
        left: (H, W) grey or (H, W, 3) RGB, uint8 or uint16.
        right: like left.
        rig: rectified rig of the same image size.
        id: the source's name of the frame; names its output files.
        index: position in the source.
        timestamp_ns: time of the picture.
        scan: LiDAR scan of the same moment.
        labels: labelled objects, or None where the source has no labels for it.
        pose: ground truth `T_map_base_link`.
        motion: of `base_link`, as an IMU measured it.
        truth: ground-truth disparity of the left image.
        mask: which pixels show something, where rectification left some that do not; None for all.
        notes: what was odd about it, for the report ("alpha channel dropped").

    Raises:
        PairMismatch: left and right differ in size, channels or depth.
        CalibrationSizeMismatch: the rig was calibrated for another image size.
        NotRectified: the rig is not rectified.
    """

    left: Image
    right: Image
    rig: StereoRig
    id: str
    index: int
    timestamp_ns: int
    scan: LidarScan | None = None
    labels: tuple[Label, ...] | None = None
    pose: Pose | None = None
    motion: BodyMotion | None = None
    truth: DisparityMap | None = None
    notes: tuple[str, ...] = ()
    mask: PairMask | None = None

    def __post_init__(self) -> None:
        _check_pair("StereoFrame", self.left, self.right, same_size=True)
        height, width = self.left.shape[:2]
        self.rig.check_size(width, height)
        if not self.rig.is_rectified:
            raise NotRectified(
                "the rig of the frame is not rectified",
                want="aligned rows",
                fix="Rectify the pair first.",
            )
        if self.truth is not None and self.truth.values.shape != (height, width):
            raise StructureError(
                f"ground truth of shape {self.truth.values.shape}",
                want=f"{(height, width)}",
                where="StereoFrame.truth",
            )
        if self.mask is not None and self.mask.left.shape != (height, width):
            raise StructureError(
                f"a mask of shape {self.mask.left.shape}",
                want=f"{(height, width)}",
                where="StereoFrame.mask",
            )

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.left.shape[1], self.left.shape[0]
