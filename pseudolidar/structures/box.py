"""Objects: 2D detections, 3D boxes, tracks, and labels of data sets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Bool, Float64, check_array
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True, eq=False)
class Detection:
    """An object in an image.

    Args:
        name: class name.
        box_px: left, top, right, bottom; pixel coordinates, first pixel centre at (0, 0).
        score: 0-1.
        mask: (H, W) pixels of the object, or None.
    """

    name: str
    box_px: tuple[float, float, float, float]
    score: float = 1.0
    mask: Bool | None = None

    def __post_init__(self) -> None:
        left, top, right, bottom = self.box_px
        if not (left <= right and top <= bottom):
            raise StructureError(
                f"box {self.box_px}", want="left <= right, top <= bottom", where="Detection"
            )


@dataclass(frozen=True, eq=False)
class Box3D:
    """An oriented metric box with error bars.

    Args:
        pose: `T_frame_box`; box axes x = length (forward), y = width (left), z = height (up),
            origin at the centre.
        length_m: extent along box x.
        width_m: extent along box y.
        height_m: extent along box z.
        sigma_m: (6,) float64 one standard deviation of centre x, y, z in the box's axes,
            length, width, height; or None.
    """

    pose: Pose
    length_m: float
    width_m: float
    height_m: float
    sigma_m: Float64 | None = None

    def __post_init__(self) -> None:
        if not (self.length_m > 0 and self.width_m > 0 and self.height_m > 0):
            size = (self.length_m, self.width_m, self.height_m)
            raise StructureError(f"box size {size} m", want="positive", where="Box3D")
        if self.sigma_m is not None:
            check_array("Box3D", "sigma_m", self.sigma_m, (6,), np.float64)

    def corners_m(self) -> Float64:
        """(8, 3) corners in the pose's destination frame."""
        half = 0.5 * np.array([self.length_m, self.width_m, self.height_m])
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return self.pose.apply(signs * half)


@dataclass(frozen=True, eq=False)
class Label:
    """A labelled object of a data set.

    Args:
        detection: class and 2D box.
        box: 3D box, or None where the label has none (KITTI `DontCare`).
        truncation: 0-1 share outside the image, or None.
        occlusion: KITTI's 0-3, or None.
        ignore: regions that an evaluation must leave out.
        track_id: identity over time where the data set has it.
        alpha_rad: observation angle as annotated (KITTI); it is rounded, so not derived from the
            box.
    """

    detection: Detection
    box: Box3D | None
    truncation: float | None = None
    occlusion: int | None = None
    ignore: bool = False
    track_id: int | None = None
    alpha_rad: float | None = None


@dataclass(frozen=True, eq=False)
class Track:
    """A box with identity over time.

    Args:
        track_id: identity.
        box: where it is now.
        velocity_m_s: (3,) float64 in the box's destination frame.
        sigma_velocity_m_s: (3,) float64, one standard deviation.
    """

    track_id: int
    box: Box3D
    velocity_m_s: Float64
    sigma_velocity_m_s: Float64

    def __post_init__(self) -> None:
        check_array("Track", "velocity_m_s", self.velocity_m_s, (3,), np.float64)
        check_array("Track", "sigma_velocity_m_s", self.sigma_velocity_m_s, (3,), np.float64)
