"""Grey 8-bit images for matching, by one stated rule for every pixel format."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Image, UInt8

# ITU-R BT.601 luma of R, G, B, the weights of OpenCV's RGB2GRAY; and in 14-bit fixed point.
LUMA = np.array([0.299, 0.587, 0.114])
_RED, _GREEN, _BLUE, _BITS = 4899, 9617, 1868, 14


def grey8_pair(left: Image, right: Image) -> tuple[UInt8, UInt8]:
    """Both images as (H, W) uint8 grey.

    16-bit images are shifted right by the same number of bits on both sides, the smallest that
    brings the brightest pixel of the pair into 8 bits; 8-bit images keep their values.
    """
    shift = shift_to_8_bits(left, right)
    return _grey8(left, shift), _grey8(right, shift)


def grey8_left(left: Image, right: Image) -> UInt8:
    """The left image of a pair as `grey8_pair` makes it."""
    return _grey8(left, shift_to_8_bits(left, right))


def grey8_of(image: Image) -> UInt8:
    """One image as (H, W) uint8 grey, by the same rule."""
    return _grey8(image, shift_to_8_bits(image))


def shift_to_8_bits(*images: Image) -> int:
    """Bits that the brightest pixel of a pair has beyond 8; 0 for 8-bit images."""
    if images[0].dtype == np.uint8:
        return 0
    return max(0, max(int(image.max()) for image in images).bit_length() - 8)


def rgb8(image: Image, shift: int) -> UInt8:
    """(H, W, 3) uint8: 16-bit values by a shift, grey ones thrice."""
    values = image if image.dtype == np.uint8 else (image >> shift).astype(np.uint8)
    return np.ascontiguousarray(rgb_of(np.asarray(values, np.uint8)))


def rgb_of(image: UInt8) -> UInt8:
    """(H, W, 3) of an image of 8 bits, a grey one thrice; the same array where it has colours."""
    return image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)


def _grey8(image: Image, shift: int) -> UInt8:
    grey = image if image.ndim == 2 else _luma(image)
    if grey.dtype == np.uint16:
        return (grey >> shift).astype(np.uint8)
    return np.ascontiguousarray(grey, dtype=np.uint8)


def _luma(image: Image) -> AnyArray:
    import cv2

    if image.dtype == np.uint8:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    weights = np.array([_RED, _GREEN, _BLUE], np.uint32)
    half = np.uint32(1 << (_BITS - 1))
    return ((image.astype(np.uint32) @ weights + half) >> _BITS).astype(np.uint16)
