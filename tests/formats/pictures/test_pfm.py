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
)
from pseudolidar.formats.pictures.pfm import (
    decode_pfm,
    encode_pfm,
    read_depth_pfm,
    read_pfm,
    write_pfm,
)
from pseudolidar.structures.disparity import DepthMap, DisparityMap

VALUES = np.array([[1.5, np.nan, 3e-7], [400.25, 5, 6]], np.float32)
BOTTOM_TO_TOP = np.array([[400.25, 5, 6], [1.5, np.inf, 3e-7]], np.float32)


def test_bytes_are_those_of_middlebury():
    assert encode_pfm(DisparityMap(VALUES)) == b"Pf\n3 2\n-1.0\n" + BOTTOM_TO_TOP.tobytes()


@pytest.mark.parametrize("scale", ["-1.0", "-1", "-0.003922", "1.0", "+1", "1e0", "255"])
@pytest.mark.parametrize("header", ["Pf\n3 2\n{}\n", "Pf 3 2 {} ", "Pf\r\n3 2\r\n{}\r\n"])
def test_headers_and_byte_orders(scale, header):
    kind = "<f4" if scale.startswith("-") else ">f4"
    data = header.format(scale).encode() + BOTTOM_TO_TOP.astype(kind).tobytes()
    got = decode_pfm(data)
    np.testing.assert_array_equal(got, VALUES)
    assert got.dtype == np.float32


def test_first_pixel_may_look_like_white_space():
    first = np.frombuffer(b"\n\r\n\x40", "<f4")
    data = b"Pf\n1 1\n-1\n" + first.tobytes()
    np.testing.assert_array_equal(decode_pfm(data), [first])


def test_what_is_not_positive_is_none():
    pixels = np.array([0, -1, -np.inf, np.nan, 2], "<f4")
    got = decode_pfm(b"Pf\n5 1\n-1\n" + pixels.tobytes())
    np.testing.assert_array_equal(got, [[np.nan, np.nan, np.nan, np.nan, 2]])


@pytest.mark.parametrize(("noun", "read"), [(DisparityMap, read_pfm), (DepthMap, read_depth_pfm)])
def test_files(tmp_path, noun, read):
    path = tmp_path / "map.pfm"
    write_pfm(path, noun(VALUES))
    got = read(path)
    assert type(got) is noun
    np.testing.assert_array_equal(got.values, VALUES)
    with pytest.raises(ImageMissing):
        read(tmp_path / "absent.pfm")


def test_opencv_reads_it(tmp_path):
    path = tmp_path / "map.pfm"
    write_pfm(path, DisparityMap(VALUES))
    read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, np.where(np.isnan(VALUES), np.inf, VALUES))


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (b"PF\n1 1\n-1\n" + bytes(12), ImageFormat),
        (b"Pf\n0 1\n-1\n", ImageUnreadable),
        (b"Pf\n1 1\n0\n" + bytes(4), ImageUnreadable),
        (b"Pf\n1 1\n-1\n" + bytes(5), ImageUnreadable),
        (b"Pf\n-1 1\n-1\n" + bytes(4), ImageUnreadable),
        (b"Pf\n1 1\nnan\n" + bytes(4), ImageUnreadable),
        (b"\x89PNG\r\n\x1a\n" + bytes(50), ImageUnreadable),
        (b"Pf\n99999 99999\n-1\n" + bytes(4), LimitError),
        (b"Pf\n9999 9999\n-1\n" + bytes(4), ImageTruncated),
    ],
)
def test_refused(data, error):
    with pytest.raises(error) as raised:
        decode_pfm(data)
    assert type(raised.value) is error
