"""What messages of recordings say, whatever schema they have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Float64
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class EncodedPicture:
    """A picture as the bytes of a file.

    Args:
        stamp_ns: time of the picture.
        frame: optical frame of its camera.
        data: the file.
        format: what the message calls it: `png`, `bgr8; jpeg compressed bgr8`.
    """

    stamp_ns: int
    frame: str
    data: bytes
    format: str


@dataclass(frozen=True, eq=False)
class RawPicture:
    """A picture as rows of pixels.

    Args:
        stamp_ns: time of the picture.
        frame: optical frame of its camera.
        width_px: pixels of a row.
        height_px: rows.
        encoding: as ROS and Foxglove name it.
        step_bytes: bytes of a row, padding included.
        big_endian: order of the bytes of pixels with several.
        data: the rows.
    """

    stamp_ns: int
    frame: str
    width_px: int
    height_px: int
    encoding: str
    step_bytes: int
    big_endian: bool
    data: bytes | memoryview


@dataclass(frozen=True, eq=False)
class CameraInfo:
    """A camera as messages describe it.

    Args:
        stamp_ns: time of the message.
        frame: optical frame.
        width_px: image width.
        height_px: image height.
        model: of the lens distortion.
        D: (n,) distortion coefficients of the unrectified image.
        K: (3, 3) intrinsics of the unrectified image.
        R: (3, 3) rectifying rotation.
        P: (3, 4) projection of the rectified image; `P[0, 3]` is -f B for the right camera.
    """

    stamp_ns: int
    frame: str
    width_px: int
    height_px: int
    model: str
    D: Float64
    K: Float64
    R: Float64
    P: Float64

    @property
    def is_calibrated(self) -> bool:
        """Whether it says more than a size: a focal length of 0 is how it says that it does not."""
        return bool(np.isfinite(self.P).all() and self.P[0, 0] > 0 and self.P[1, 1] > 0)


@dataclass(frozen=True, eq=False)
class CloudMessage:
    """A cloud.

    Args:
        stamp_ns: time of the cloud.
        cloud: its points with all columns.
        notes: what was odd about it.
    """

    stamp_ns: int
    cloud: PointCloud
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class StampedPose:
    """A transform or a pose at a time.

    Args:
        stamp_ns: its time, 0 where it always holds.
        pose: `T_parent_child`.
    """

    stamp_ns: int
    pose: Pose


@dataclass(frozen=True, eq=False)
class Transforms:
    """Transforms between frames.

    Args:
        poses: in the order of the message.
    """

    poses: tuple[StampedPose, ...]

    @property
    def stamp_ns(self) -> int:
        """Time of the first."""
        return self.poses[0].stamp_ns if self.poses else 0


@dataclass(frozen=True)
class Mark:
    """A mark of a frame in a recording of this package.

    Args:
        stamp_ns: time of the frame.
        name: id of the frame.
        text: what else it says.
        detail: lines about the cloud of the frame.
    """

    stamp_ns: int
    name: str
    text: str
    detail: str = ""


Message = EncodedPicture | RawPicture | CameraInfo | CloudMessage | Transforms | Mark


def column_values(values: AnyArray | tuple[float, ...] | list[float], count: int) -> Float64:
    """(count,) numbers of a message's array.

    Raises:
        ValueError: another count.
    """
    array = np.asarray(values, np.float64).reshape(-1)
    if len(array) != count:
        raise ValueError(f"{len(array)} numbers where {count} belong")
    return array
