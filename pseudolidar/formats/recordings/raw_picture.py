"""Pixels of raw pictures in messages: the encodings of ROS and Foxglove.

Source: sensor_msgs/image_encodings.hpp; REP-118 for depth (16UC1 mm, 32FC1 m).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np

from pseudolidar.errors import ImageFormat, ImageTruncated, LimitError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.formats.pictures.image import DecodedImage, decode_image
from pseudolidar.formats.recordings.messages import EncodedPicture, RawPicture
from pseudolidar.structures.arrays import AnyArray, Float32, Image

MM_PER_M = 1000.0
# NumPy code and channels of a pixel.
PIXELS: Mapping[str, tuple[str, int]] = {
    "mono8": ("u1", 1), "8UC1": ("u1", 1), "mono16": ("u2", 1), "16UC1": ("u2", 1),
    "rgb8": ("u1", 3), "bgr8": ("u1", 3), "8UC3": ("u1", 3),
    "rgba8": ("u1", 4), "bgra8": ("u1", 4), "8UC4": ("u1", 4),
    "rgb16": ("u2", 3), "bgr16": ("u2", 3), "16UC3": ("u2", 3),
    "rgba16": ("u2", 4), "bgra16": ("u2", 4), "16UC4": ("u2", 4),
    "32FC1": ("f4", 1),
    "yuv422": ("u1", 2), "uyvy": ("u1", 2), "yuv422_yuy2": ("u1", 2), "yuyv": ("u1", 2),
    **{f"bayer_{mosaic}8": ("u1", 1) for mosaic in ("rggb", "bggr", "gbrg", "grbg")},
    **{f"bayer_{mosaic}16": ("u2", 1) for mosaic in ("rggb", "bggr", "gbrg", "grbg")},
}  # fmt: skip
# OpenCV counts its mosaics from the second row and column.
_BAYER = {"rggb": "BG", "bggr": "RG", "gbrg": "GR", "grbg": "GB"}
_DEPTHS = ("16UC1", "mono16", "32FC1")


def picture_pixels(
    picture: EncodedPicture | RawPicture, name: str, *, limits: Limits = DEFAULT_LIMITS
) -> DecodedImage:
    """Grey or RGB pixels of a message.

    Args:
        picture: the message.
        name: topic, for errors.
        limits: caps.

    Raises:
        ImageUnreadable, ImageTruncated, ImageFormat, LimitError: as `decode_image`; depth is none.
    """
    if isinstance(picture, EncodedPicture):
        return decode_image(picture.data, name, limits=limits)
    values = _values(picture, name, limits)
    encoding = picture.encoding.lower()
    if encoding == "32fc1":
        raise ImageFormat("32-bit numbers (32FC1)", want="a picture: 8 or 16 bits", path=name)
    if encoding.startswith("bayer"):
        return DecodedImage(_demosaiced(values, encoding[6:10]), ("colours from a Bayer mosaic",))
    if values.ndim == 2:
        return DecodedImage(values)
    if values.shape[2] == 2:
        return DecodedImage(_from_yuv(values, encoding))
    notes = ("alpha channel dropped",) if values.shape[2] == 4 else ()
    order = slice(None) if encoding.startswith("rgb") else slice(None, None, -1)
    return DecodedImage(np.ascontiguousarray(values[:, :, :3][:, :, order]), notes)


def depth_values_m(
    picture: EncodedPicture | RawPicture, name: str, *, limits: Limits = DEFAULT_LIMITS
) -> Float32:
    """(H, W) depths of a message, m: 16 bits are mm, 0 and what is not finite is NaN.

    Raises:
        ImageFormat: the message is of another encoding; and what `picture_pixels` raises.
    """
    if isinstance(picture, EncodedPicture):
        values: AnyArray = decode_image(_png_of(picture), name, limits=limits).pixels
    elif picture.encoding in _DEPTHS:
        values = _values(picture, name, limits)
    else:
        raise ImageFormat(
            f"encoding {picture.encoding!r}", want=f"depth: {', '.join(_DEPTHS)}", path=name
        )
    if values.ndim != 2 or values.dtype == np.uint8:
        raise ImageFormat(
            f"{values.dtype} pixels of shape {values.shape}", want="16-bit depth", path=name
        )
    depth_m = values.astype(np.float32)
    if values.dtype == np.uint16:
        depth_m /= np.float32(MM_PER_M)
    depth_m[~(np.isfinite(depth_m) & (depth_m > 0))] = np.nan
    return depth_m


def is_depth(picture: EncodedPicture | RawPicture) -> bool:
    """Whether a picture is of depths: by its encoding."""
    if isinstance(picture, EncodedPicture):
        return "compressedDepth" in picture.format or picture.format.startswith("16UC1")
    return picture.encoding in ("16UC1", "32FC1")


def _png_of(picture: EncodedPicture) -> bytes:
    """The PNG in the message; ROS's `compressedDepth` has twelve bytes of its own before it."""
    at = picture.data.find(b"\x89PNG", 0, 64)
    return picture.data[at:] if at > 0 else picture.data


def _values(picture: RawPicture, name: str, limits: Limits) -> AnyArray:
    """(H, W) or (H, W, channels) values as they are in the message."""
    known = {encoding.lower(): pixel for encoding, pixel in PIXELS.items()}
    pixel = known.get(picture.encoding.lower())
    if pixel is None:
        raise ImageFormat(
            f"encoding {picture.encoding!r}", want=f"one of {', '.join(PIXELS)}", path=name
        )
    code, channels = pixel
    width, height, step = picture.width_px, picture.height_px, picture.step_bytes
    if width * height > limits.pixels:
        raise LimitError(
            f"a picture of {width}x{height} pixels",
            want=f"at most {limits.pixels} pixels",
            fix=raise_cap("pixels"),
            path=name,
        )
    row = width * channels * np.dtype(code).itemsize
    if width < 1 or height < 1 or step < row or len(picture.data) < step * (height - 1) + row:
        raise ImageTruncated(
            f"{len(picture.data)} bytes, {step} a row",
            want=f"{width}x{height} pixels of {picture.encoding}",
            path=name,
        )
    dtype = np.dtype((">" if picture.big_endian else "<") + code)
    rows = np.lib.stride_tricks.as_strided(
        np.frombuffer(picture.data, np.uint8), (height, row), (step, 1), writeable=False
    )
    values = np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="), copy=False)
    return values if channels == 1 else values.reshape(height, width, channels)


def _demosaiced(values: AnyArray, mosaic: str) -> Image:
    import cv2

    code = getattr(cv2, f"COLOR_Bayer{_BAYER[mosaic]}2RGB")
    return cast("Image", cv2.cvtColor(values, code))


def _from_yuv(values: AnyArray, encoding: str) -> Image:
    """RGB of 4:2:2; `yuv422` of ROS is UYVY."""
    import cv2

    if values.shape[1] % 2:
        raise ImageFormat(f"{values.shape[1]} columns of {encoding}", want="an even number")
    code = cv2.COLOR_YUV2RGB_UYVY if encoding in ("yuv422", "uyvy") else cv2.COLOR_YUV2RGB_YUYV
    return cast("Image", cv2.cvtColor(values, code))
