from __future__ import annotations

import cv2
import numpy as np
import pytest

from pseudolidar.errors import (
    ImageFormat,
    ImageMissing,
    ImageTruncated,
    ImageUnreadable,
    LimitError,
    StructureError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.depth_png import encode_depth_png, read_depth_png, write_depth_png
from pseudolidar.formats.pictures.disparity_png import (
    encode_disparity_png,
    read_disparity_png,
    write_disparity_png,
)
from pseudolidar.structures.disparity import DepthMap, DisparityMap

ROW = np.array([[np.nan, 0, -3, np.inf, 1e-4, 1 / 512 - 1e-5, 0.01, 37.123, 255.996]], np.float32)
STEPS = [[0, 0, 0, 0, 1, 1, 3, 9503, 65535]]


def steps(data: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize(
    "encode",
    [lambda v: encode_disparity_png(DisparityMap(v)), lambda v: encode_depth_png(DepthMap(v))],
)
def test_scale_and_none(encode):
    decoded = steps(encode(ROW))
    assert decoded.dtype == np.uint16
    assert decoded.tolist() == STEPS


@pytest.mark.parametrize(
    ("write", "read", "noun"),
    [
        (write_disparity_png, read_disparity_png, DisparityMap),
        (write_depth_png, read_depth_png, DepthMap),
    ],
)
def test_round_trip_to_half_a_step(tmp_path, write, read, noun):
    rng = np.random.default_rng(4)
    values = (rng.random((37, 53)) * 250 + 0.01).astype(np.float32)
    values[rng.random(values.shape) < 0.3] = np.nan
    path = tmp_path / "map.png"
    write(path, noun(values, sigma=np.ones_like(values)))
    got = read(path)
    assert type(got) is noun
    assert got.sigma is None
    assert got.values.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(got.values), np.isnan(values))
    assert np.nanmax(np.abs(got.values - values)) <= 0.5 / 256
    write(tmp_path / "again.png", got)  # what was read is on the steps
    assert (tmp_path / "again.png").read_bytes() == path.read_bytes()


def test_disparity_beyond_the_range_is_refused_not_lost():
    with pytest.raises(StructureError, match=r"256\.0 px") as error:
        encode_disparity_png(DisparityMap(np.full((1, 1), 256, np.float32)))
    assert "PFM" in error.value.fix


def test_depth_beyond_the_range_is_none():
    values = np.array([[255.996, 255.997, 256, 1e9]], np.float32)
    assert steps(encode_depth_png(DepthMap(values))).tolist() == [[65535, 0, 0, 0]]


@pytest.mark.real
def test_real_ground_truth(real_data):
    path = real_data / "kitti_stereo2015/training/disp_occ_0/000002_10.png"
    got = read_disparity_png(path)
    raw = steps(path.read_bytes())
    assert 0.1 < got.density < 0.3
    np.testing.assert_array_equal(got.values[raw > 0], raw[raw > 0] / np.float32(256))
    np.testing.assert_array_equal(steps(encode_disparity_png(got)), raw)


@pytest.mark.parametrize("read", [read_disparity_png, read_depth_png])
@pytest.mark.parametrize(
    "pixels",
    [np.ones((4, 5), np.uint8), np.ones((4, 5, 3), np.uint8), np.ones((4, 5, 3), np.uint16)],
)
def test_eight_bits_and_colours_are_never_metric(tmp_path, read, pixels):
    path = tmp_path / "view.png"
    path.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
    with pytest.raises(ImageFormat) as error:
        read(path)
    assert (error.value.path, "16 bits" in error.value.want) == (str(path), True)


def test_cut_at_every_byte_and_flipped_bits(tmp_path):
    values = np.random.default_rng(1).random((9, 11), np.float32) * 99
    data = encode_disparity_png(DisparityMap(values))
    path = tmp_path / "cut.png"
    for size in range(len(data)):
        path.write_bytes(data[:size])
        with pytest.raises((ImageTruncated, ImageUnreadable)):
            read_disparity_png(path)
    for at in range(8, len(data)):
        path.write_bytes(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])
        with pytest.raises((ImageUnreadable, ImageFormat, LimitError)):
            read_disparity_png(path)


def test_missing_and_too_large(tmp_path):
    with pytest.raises(ImageMissing):
        read_disparity_png(tmp_path / "absent.png")
    path = tmp_path / "map.png"
    write_disparity_png(path, DisparityMap(np.ones((20, 20), np.float32)))
    with pytest.raises(LimitError):
        read_disparity_png(path, limits=Limits(pixels=399))
