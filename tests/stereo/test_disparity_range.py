"""How many disparities are searched."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import StereoConfig
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.disparity_range import check_range, disparity_range
from pseudolidar.stereo.sgbm import Bm, Sgbm
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose


def rig(width_px: int, *, doffs_px: float = 0.0, fB_px_m: float = 384.0) -> StereoRig:
    eyes = []
    for side, shift_px in (("left", 0.0), ("right", doffs_px)):
        K = np.array([[768.0, 0, width_px / 2 + shift_px], [0, 768.0, 50], [0, 0, 1]])
        eyes.append(Camera(K, width_px, 100, frame=f"camera_{side}"))
    baseline = np.array([-fB_px_m / 768.0, 0, 0])
    T = Pose.from_rotation("camera_right", "camera_left", np.eye(3), baseline)
    return StereoRig(*eyes, T)


@pytest.mark.parametrize(
    ("width_px", "min_depth_m", "disparities"),
    [
        (1242, 3.0, 128),  # KITTI's colour cameras
        (1242, 4.0, 96),
        (1242, 2.0, 192),
        (1242, 1000.0, 32),  # never less than one step
        (1242, 0.1, 608),  # never above half the width
        (130, 0.1, 64),
        (64, 3.0, 32),
    ],
)
def test_range_follows_the_nearest_depth(width_px, min_depth_m, disparities):
    assert disparity_range(rig(width_px), min_depth_m) == disparities


def test_an_offset_of_the_principal_points_is_no_depth():
    assert disparity_range(rig(1242, doffs_px=32.0), 3.0) == 96
    assert disparity_range(rig(1242, doffs_px=-32.0), 3.0) == 160


def test_too_narrow_for_any_range():
    with pytest.raises(StereoConfig, match="63 px wide; wanted at least 64 px"):
        disparity_range(rig(63), 3.0)


@pytest.mark.parametrize("min_depth_m", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("matcher", [Census(), Sgbm(), Bm()])
def test_a_depth_that_is_none_is_refused_before_a_frame_is_read(matcher, min_depth_m):
    with pytest.raises(StereoConfig, match="--min-depth"):
        matcher.load(min_depth_m=min_depth_m)


def test_a_range_must_fit_the_image():
    check_range(96, 97, multiple=32)
    with pytest.raises(StereoConfig, match="at most 64"):
        check_range(96, 96, multiple=32)
    with pytest.raises(StereoConfig, match="wider than 16 px"):
        check_range(16, 16, multiple=16)
