"""What is odd about a rig is said, and nothing of what is usual."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.geometry.odd_rig import field_deg, oddities
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose
from tests.raw_rigs import raw_rig
from tests.recordings import small_rig

RIG = raw_rig(5)


def left(**changes: object) -> StereoRig:
    return replace(RIG, left=replace(RIG.left, **changes))  # type: ignore[arg-type]


def placed(x_m: float, y_m: float, z_m: float, turn_deg: float = 0.0) -> StereoRig:
    R = cv2.Rodrigues(np.radians([0.0, turn_deg, 0.0]))[0]
    t_m = -R @ np.array([x_m, y_m, z_m])
    return replace(RIG, T_right_left=Pose.from_rotation("camera_right", "camera_left", R, t_m))


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12])
def test_usual_rigs_have_nothing_odd(count: int) -> None:
    assert oddities(raw_rig(count)) == ()
    assert oddities(raw_rig(4, model="fisheye")) == ()
    assert oddities(small_rig()) == ()


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        (left(K=RIG.left.K * [[15, 1, 1], [1, 15, 1], [1, 1, 1]]), "left: a field of 5 degrees"),
        (left(K=RIG.left.K * [[0.1, 1, 1], [1, 0.1, 1], [1, 1, 1]]), "left: a field of 162 deg"),
        (left(K=RIG.left.K * [[1, 1, 1], [1, 1.1, 1], [1, 1, 1]]), "pixels that are not square"),
        (left(K=RIG.left.K * [[1, 1, 0.2], [1, 1, 1], [1, 1, 1]]), "far from the middle"),
        (left(distortion=np.array([-1.2, 0.3, 0, 0, 0])), "the lens model turns back"),
        (placed(0.001, 0, 0), "cameras 0.001 m apart: is the unit right?"),
        (placed(5.0, 0, 0), "cameras 5 m apart"),
        (placed(0.1, 0.06, 0), "the right camera 0.06 m below the left one"),
        (placed(0.1, 0, -0.06), "the right camera 0.06 m behind the left one"),
        (placed(0.1, 0, 0, 30), "cameras that look 30 degrees apart"),
    ],
)
def test_each_oddity_is_said(rig: StereoRig, words: str) -> None:
    assert any(words in text for text in oddities(rig)), oddities(rig)


def test_fields_of_view() -> None:
    K = np.array([[320.0, 0, 319.5], [0, 320, 239.5], [0, 0, 1]])
    across, down = field_deg(Camera(K, 640, 480))
    assert across == pytest.approx(2 * np.degrees(np.arctan(319.5 / 320)))
    assert down == pytest.approx(2 * np.degrees(np.arctan(239.5 / 320)))
    # A fisheye without distortion numbers: angle = radius / f, also beyond 180 degrees.
    wide = Camera(K * [[0.5, 1, 1], [1, 0.5, 1], [1, 1, 1]], 640, 480, np.zeros(4), "fisheye")
    assert field_deg(wide)[0] == pytest.approx(np.degrees(2 * 319.5 / 160), abs=1e-6)
