from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pseudolidar.errors import ImageFormat, ImageTruncated, LimitError, PseudolidarError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.recordings.messages import EncodedPicture, RawPicture
from pseudolidar.formats.recordings.raw_picture import (
    PIXELS,
    depth_values_m,
    is_depth,
    picture_pixels,
)

HEIGHT, WIDTH = 6, 8


def raw(values: np.ndarray, encoding: str, *, padding: int = 0, big: bool = False) -> RawPicture:
    rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
    data = np.pad(rows, ((0, 0), (0, padding)))
    width = PIXELS[encoding]
    columns = rows.shape[1] // (np.dtype(width[0]).itemsize * width[1])
    return RawPicture(1, "left", columns, len(values), encoding, data.shape[1], big, data.tobytes())


@pytest.fixture
def rgb() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def test_colours_in_every_order(rgb: np.ndarray) -> None:
    alpha = np.full((HEIGHT, WIDTH, 1), 9, np.uint8)
    for encoding, values in {
        "rgb8": rgb,
        "bgr8": rgb[:, :, ::-1],
        "8UC3": rgb[:, :, ::-1],  # OpenCV's order
        "rgba8": np.concatenate([rgb, alpha], axis=2),
        "bgra8": np.concatenate([rgb[:, :, ::-1], alpha], axis=2),
    }.items():
        image = picture_pixels(raw(values, encoding, padding=5), "/left")
        np.testing.assert_array_equal(image.pixels, rgb, err_msg=encoding)
        assert (image.notes != ()) == encoding.endswith("a8")


@pytest.mark.parametrize("big", [False, True])
def test_sixteen_bits_in_either_byte_order(big: bool) -> None:
    grey = np.random.default_rng(2).integers(0, 65536, (HEIGHT, WIDTH), np.uint16)
    stored = grey.astype(">u2" if big else "<u2")
    image = picture_pixels(raw(stored, "mono16", padding=3, big=big), "/left")
    assert image.pixels.dtype == np.uint16
    np.testing.assert_array_equal(image.pixels, grey)


@pytest.mark.parametrize("mosaic", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_a_mosaic_of_one_colour_is_that_colour(mosaic: str, bits: int) -> None:
    colour = {"r": 200, "g": 120, "b": 40}
    kind = np.uint8 if bits == 8 else np.uint16
    tile = np.array([colour[c] for c in mosaic], kind).reshape(2, 2)
    values = np.tile(tile, (HEIGHT // 2, WIDTH // 2))
    image = picture_pixels(raw(values, f"bayer_{mosaic}{bits}"), "/left")
    assert image.pixels.dtype == kind
    np.testing.assert_array_equal(image.pixels[2:-2, 2:-2].reshape(-1, 3), [[200, 120, 40]] * 8)


@pytest.mark.parametrize("encoding", ["yuv422", "uyvy", "yuv422_yuy2", "yuyv"])
def test_yuv_of_one_colour(encoding: str) -> None:
    colour = np.full((HEIGHT, WIDTH, 3), (30, 160, 90), np.uint8)
    r, g, b = colour[0, 0] / 255.0
    # BT.601, 16-235 for black to white.
    y = round(16 + 65.481 * r + 128.553 * g + 24.966 * b)
    u = round(128 - 37.797 * r - 74.203 * g + 112.0 * b)
    v = round(128 + 112.0 * r - 93.786 * g - 18.214 * b)
    pair = [u, y, v, y] if encoding in ("yuv422", "uyvy") else [y, u, y, v]
    values = np.tile(np.array(pair, np.uint8), (HEIGHT, WIDTH // 2))
    picture = RawPicture(1, "left", WIDTH, HEIGHT, encoding, 2 * WIDTH, False, values.tobytes())
    image = picture_pixels(picture, "/left")
    np.testing.assert_allclose(image.pixels[2, 2], colour[0, 0], atol=2)


def test_depths_are_metres_and_holes_nan() -> None:
    mm = np.array([[0, 1500], [65535, 20]], np.uint16)
    depth = depth_values_m(raw(mm, "16UC1"), "/depth")
    np.testing.assert_allclose(depth, [[np.nan, 1.5], [65.535, 0.02]], rtol=1e-6)
    metres = np.array([[np.nan, 1.5], [np.inf, -2]], np.float32)
    np.testing.assert_array_equal(
        depth_values_m(raw(metres, "32FC1"), "/depth"), [[np.nan, 1.5], [np.nan, np.nan]]
    )
    packed = EncodedPicture(1, "left", bytes(12) + encode_png(mm), "16UC1; compressedDepth png")
    assert is_depth(packed)
    np.testing.assert_array_equal(depth_values_m(packed, "/depth"), depth)
    with pytest.raises(ImageFormat, match="32FC1"):
        picture_pixels(raw(metres, "32FC1"), "/depth")
    with pytest.raises(ImageFormat, match="rgb8"):
        depth_values_m(raw(np.zeros((2, 2, 3), np.uint8), "rgb8"), "/depth")


def lie(**changes: Any) -> RawPicture:
    fields = {
        "stamp_ns": 1,
        "frame": "left",
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "encoding": "rgb8",
        "step_bytes": 3 * WIDTH,
        "big_endian": False,
        "data": bytes(3 * WIDTH * HEIGHT),
    } | changes
    return RawPicture(**fields)


@pytest.mark.parametrize(
    ("picture", "error"),
    [
        (lie(width_px=WIDTH + 1), ImageTruncated),
        (lie(height_px=HEIGHT + 1), ImageTruncated),
        (lie(step_bytes=0), ImageTruncated),
        (lie(width_px=0), ImageTruncated),
        (lie(width_px=2**31, height_px=2**31), LimitError),
        (lie(encoding="jpeg"), ImageFormat),
        (lie(data=b""), ImageTruncated),
    ],
)
def test_sizes_that_lie_are_refused_before_anything_is_made(
    picture: RawPicture, error: type[PseudolidarError]
) -> None:
    with pytest.raises(error, match="/left"):
        picture_pixels(picture, "/left")


def test_the_cap_on_pixels() -> None:
    with pytest.raises(LimitError):
        picture_pixels(lie(), "/left", limits=Limits(pixels=WIDTH * HEIGHT - 1))
