"""Pairs as they are, and as mistakes make them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.arrays import Image
from pseudolidar.structures.frame import StereoFrame


def warped(image: Image, *, down_px: float = 0.0, roll_deg: float = 0.0) -> Image:
    """The picture moved down and rolled about its centre (anticlockwise), in whole frame."""
    height, width = image.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), roll_deg, 1.0)
    matrix[1, 2] += down_px
    return np.asarray(cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REFLECT))


def swapped(frame: StereoFrame) -> StereoFrame:
    return replace(frame, left=frame.right, right=frame.left)


def right_moved(frame: StereoFrame, **how: float) -> StereoFrame:
    return replace(frame, right=warped(frame.right, **how))


def right_turned(frame: StereoFrame, turn_deg: tuple[float, float, float]) -> StereoFrame:
    """The pair with its right eye turned by a rotation vector: pitch, yaw, roll, exactly."""
    K = frame.rig.right.K
    turn = exp_twist(np.concatenate([np.zeros(3), np.radians(turn_deg)]))[:3, :3]
    height, width = frame.right.shape[:2]
    shown = cv2.warpPerspective(
        frame.right, K @ turn @ np.linalg.inv(K), (width, height), flags=cv2.INTER_CUBIC
    )
    return replace(frame, right=np.asarray(shown))


def left_moved(frame: StereoFrame, **how: float) -> StereoFrame:
    return replace(frame, left=warped(frame.left, **how))


# Every one must stop a run.
ROWS_OFF: dict[str, Callable[[StereoFrame], StereoFrame]] = {
    **{
        f"{px} px": lambda frame, px=px: right_moved(frame, down_px=px)
        for px in (-5, -3, -2, 2, 3, 5)
    },
    **{
        f"{deg} degrees": lambda frame, deg=deg: right_moved(frame, roll_deg=deg)
        for deg in (-1.0, -0.5, 0.5, 1.0)
    },
    "left eye 0.5 degrees": lambda frame: left_moved(frame, roll_deg=0.5),
}
