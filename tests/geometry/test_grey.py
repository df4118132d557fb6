"""One rule for every pixel format."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pseudolidar.geometry.grey import grey8_pair, rgb_of, shift_to_8_bits


@pytest.fixture(scope="module")
def colours() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (20, 30, 3), np.uint8)


def test_grey_8_bit_stays_as_it_is(colours):
    left, right = colours[:, :, 0], colours[:, ::-1, 1]
    found = grey8_pair(left, right)
    for image, grey in zip((left, right), found, strict=True):
        np.testing.assert_array_equal(grey, image)
        assert grey.flags.c_contiguous


def test_colour_becomes_luma_of_red_green_blue(colours):
    grey, _ = grey8_pair(colours, colours)
    luma = colours @ np.array([0.299, 0.587, 0.114])
    assert np.abs(grey - luma).max() <= 0.51
    np.testing.assert_array_equal(grey, cv2.cvtColor(colours, cv2.COLOR_RGB2GRAY))


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_deep_images_lose_the_bits_beyond_the_brightest_pixel(bits):
    rng = np.random.default_rng(bits)
    left, right = rng.integers(0, 1 << bits, (2, 9, 11), np.uint16)
    left[0, 0] = (1 << bits) - 1
    assert shift_to_8_bits(left, right) == shift_to_8_bits(right, left) == bits - 8
    for image, grey in zip((left, right), grey8_pair(left, right), strict=True):
        assert grey.dtype == np.uint8
        np.testing.assert_array_equal(grey, image >> (bits - 8))


def test_both_eyes_are_shifted_alike():
    """The brighter eye decides: shifted apart, equal surfaces would have unequal values."""
    left, right = np.full((4, 4), 4095, np.uint16), np.full((4, 4), 1000, np.uint16)
    grey_left, grey_right = grey8_pair(left, right)
    assert (grey_left[0, 0], grey_right[0, 0]) == (255, 1000 >> 4)


def test_deep_colour_becomes_the_same_luma(colours):
    deep, _ = grey8_pair(colours.astype(np.uint16) * 257, colours.astype(np.uint16) * 257)
    flat, _ = grey8_pair(colours, colours)
    assert np.abs(deep.astype(int) - flat).max() <= 1


def test_grey_in_colours_is_grey(colours):
    assert rgb_of(colours) is colours
    thrice = rgb_of(colours[:, :, 0])
    assert thrice.shape == colours.shape
    assert (thrice == colours[:, :, :1]).all()
