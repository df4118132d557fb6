"""Objects: 2D detections, 3D boxes, tracks, and labels of data sets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Bool, Float64, check_array
from pseudolidar.structures.pose import Pose

TrackState = Literal["tentative", "confirmed", "coasting"]
# Pairs of corners, as `Box3D.corners_m` has them, that differ in one direction.
BOX_EDGES = tuple((a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit)


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


@dataclass(frozen=True)
class Contact:
    """When something that comes nearer reaches the camera's plane, if both go on as they do.

    Args:
        time_s: from now until its nearest face is there.
        sigma_time_s: one standard deviation (68 %).
        left_m: where its left side is then, in `camera_left`, to the right positive.
        right_m: where its right side is then.
        sigma_across_m: one standard deviation of both.
    """

    time_s: float
    sigma_time_s: float
    left_m: float
    right_m: float
    sigma_across_m: float

    def within(self, half_width_m: float, *, sigmas: float = 1.0) -> bool:
        """Whether it then reaches into a corridor, or may do within so many sigmas."""
        reach_m = half_width_m + sigmas * self.sigma_across_m
        return self.left_m < reach_m and self.right_m > -reach_m


@dataclass(frozen=True, eq=False)
class Track:
    """A box with identity over time.

    Args:
        track_id: identity.
        box: where it is now.
        velocity_m_s: (3,) float64 along the axes of the box's destination frame.
        sigma_velocity_m_s: (3,) float64, one standard deviation.
        name: class name.
        state: `tentative` until seen often enough to be believed, `coasting` while it is not
            seen and only predicted.
        over_ground: the velocity is over ground; else it is relative to the camera.
        age_s: time since it was first seen.
        unseen_s: time since it was last seen.
        seen: in how many frames.
        speed_m_s: level, without what rises or sinks.
        sigma_speed_m_s: one standard deviation.
        contact: with the camera's plane; None where it surely does not come nearer.
        sigma_ahead_m: one standard deviation of the box's centre along the camera's axis.
    """

    track_id: int
    box: Box3D
    velocity_m_s: Float64
    sigma_velocity_m_s: Float64
    name: str = ""
    state: TrackState = "confirmed"
    over_ground: bool = False
    age_s: float = 0.0
    unseen_s: float = 0.0
    seen: int = 1
    speed_m_s: float = float("nan")
    sigma_speed_m_s: float = float("nan")
    contact: Contact | None = None
    sigma_ahead_m: float = float("nan")

    def __post_init__(self) -> None:
        check_array("Track", "velocity_m_s", self.velocity_m_s, (3,), np.float64)
        check_array("Track", "sigma_velocity_m_s", self.sigma_velocity_m_s, (3,), np.float64)
