"""The cameras of a frame as they stand in the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.grey import rgb_of
from pseudolidar.geometry.twists import inverted
from pseudolidar.running.reports.samples import photo_of
from pseudolidar.structures.arrays import Float64, UInt8
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.moment import Moment

# Width of the photo in a frustum, px.
PHOTO_PX = 320
# How far ahead of a camera its picture stands, m. The right one has no photo, and is smaller so
# that it does not hide the left one's.
LEFT_M, RIGHT_M = 1.5, 0.6


@dataclass(frozen=True, eq=False)
class StandingCamera:
    """A camera as it is drawn: a pyramid from its centre to its picture.

    Args:
        name: `left` or `right`; the only camera is the left one.
        camera: its intrinsics.
        T_forward_camera: (4, 4) maps points of the camera into the frame of the clouds.
        length_m: how far ahead of the centre the picture stands, m.
        photo: (H, W, 3) uint8 RGB, `PHOTO_PX` wide; None to draw the pyramid alone.
    """

    name: str
    camera: Camera
    T_forward_camera: Float64
    length_m: float
    photo: UInt8 | None = None

    @property
    def opening(self) -> tuple[float, float]:
        """Vertical angle of view, rad, and width over height of the picture."""
        camera = self.camera
        fov_rad = 2 * np.arctan2(camera.height_px / 2, float(camera.K[1, 1]))
        return float(fov_rad), camera.width_px / camera.height_px


def cameras_of(moment: Moment) -> tuple[StandingCamera, ...]:
    """The left camera of a frame with its photo, and the right one where there is a pair.

    None of clouds that came without pictures.
    """
    sight, made = moment.sight, moment.converted
    if sight is None or made is None:
        return ()
    T, frame = sight.T_forward_camera, made.frame
    left = StandingCamera("left", sight.camera, T, LEFT_M, _small(photo_of(frame)))
    if not isinstance(frame, StereoFrame):
        return (left,)
    T_left_right = inverted(frame.rig.T_right_left.matrix)
    return left, StandingCamera("right", frame.rig.right, T @ T_left_right, RIGHT_M)


def _small(photo: UInt8) -> UInt8:
    import cv2

    height, width = photo.shape[:2]
    size = PHOTO_PX, max(round(PHOTO_PX * height / width), 1)
    return rgb_of(np.asarray(cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.uint8))
