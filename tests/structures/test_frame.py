"""What a pair must be before anything works on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationSizeMismatch,
    NotRectified,
    PairMismatch,
    StructureError,
)
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan, PairMask, RawPair, StereoFrame
from pseudolidar.structures.pose import Pose

K = np.array([[50.0, 0, 16], [0, 50.0, 8], [0, 0, 1]])
T_RIGHT_LEFT = Pose.from_rotation("camera_right", "camera_left", np.eye(3), np.array([-0.5, 0, 0]))
RIG = StereoRig(Camera(K, 32, 16), Camera(K, 32, 16, frame="camera_right"), T_RIGHT_LEFT)
GREY = np.zeros((16, 32), np.uint8)
COLOUR = np.zeros((16, 32, 3), np.uint8)


@pytest.mark.parametrize("image", [GREY, COLOUR, GREY.astype(np.uint16), COLOUR.astype(np.uint16)])
def test_grey_and_colour_of_8_and_16_bits(image):
    assert StereoFrame(image, image, RIG, "0", 0, 1).size_px == (32, 16)


@pytest.mark.parametrize(
    ("left", "right", "error"),
    [
        (GREY, GREY[:, 1:], PairMismatch),
        (GREY, COLOUR, PairMismatch),
        (GREY, GREY.astype(np.uint16), PairMismatch),
        (GREY.astype(np.float32), GREY.astype(np.float32), StructureError),
        (COLOUR[..., :2], COLOUR[..., :2], StructureError),
        (GREY[1:], GREY[1:], CalibrationSizeMismatch),
    ],
    ids=["size", "channels", "depth", "floats", "two channels", "calibration"],
)
def test_pairs_that_cannot_be_matched_are_refused(left, right, error):
    with pytest.raises(error):
        StereoFrame(left, right, RIG, "0", 0, 1)


def test_unrectified_rig_is_refused():
    bent = replace(RIG.left, distortion=np.array([0.1, 0, 0, 0]))
    with pytest.raises(NotRectified):
        StereoFrame(GREY, GREY, replace(RIG, left=bent), "0", 0, 1)


def test_truth_of_another_size_is_refused():
    truth = DisparityMap(np.ones((16, 31), np.float32))
    with pytest.raises(StructureError, match="ground truth"):
        StereoFrame(GREY, GREY, RIG, "0", 0, 1, truth=truth)


@pytest.mark.parametrize(
    "columns",
    [
        {"xyz": np.zeros((5, 3))},
        {"xyz": np.zeros((5, 4), np.float32)},
        {"reflectance": np.zeros(4, np.float32)},
        {"point_times_ns": np.zeros(5)},
    ],
    ids=["doubles", "four columns", "reflectance", "times"],
)
def test_columns_of_a_scan_fit_together(columns):
    with pytest.raises(StructureError):
        LidarScan(**({"xyz": np.zeros((5, 3), np.float32)} | columns))


def test_a_raw_pair_has_eyes_of_two_sizes_and_its_own_calibration():
    bent = replace(RIG.left, distortion=np.array([0.1, 0, 0, 0]))
    large = Camera(2 * K, 64, 32, frame="camera_right")
    rig = StereoRig(bent, large, T_RIGHT_LEFT)
    twice = np.zeros((32, 64), np.uint8)
    assert RawPair(GREY, twice, rig, "0", 0, 1).right.shape == (32, 64)
    with pytest.raises(CalibrationSizeMismatch):
        RawPair(GREY, GREY, rig, "0", 0, 1)
    with pytest.raises(PairMismatch, match="the same channels"):
        RawPair(GREY, np.zeros((32, 64, 3), np.uint8), rig, "0", 0, 1)


def test_a_mask_of_another_size_is_refused():
    mask = PairMask(np.ones((16, 31), bool), np.ones((16, 31), bool))
    with pytest.raises(StructureError, match="mask"):
        StereoFrame(GREY, GREY, RIG, "0", 0, 1, mask=mask)
