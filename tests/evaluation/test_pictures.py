"""Colours mean what the legends say."""

from __future__ import annotations

import numpy as np

from pseudolidar.evaluation.pictures import (
    ERROR_COLOURS,
    NOTHING,
    disparity_picture,
    error_picture,
    thicker,
    top_picture,
)

NAN = np.nan


def row(*values):
    return np.array([values], np.float32)


def test_near_is_red_far_is_blue_and_none_is_dark():
    near, far, none = disparity_picture(row(100.0, 1.0, NAN), 100.0)[0].astype(int)
    assert near[0] > near[2]
    assert far[2] > far[0]
    assert tuple(none) == NOTHING


def test_error_changes_colour_at_the_d1_limit():
    # at 100 px the limit is 5 px, at 10 px it is 3 px
    picture = error_picture(row(104.9, 105.1, 12.9, 13.1), row(100, 100, 10, 10))[0]
    within, beyond = ERROR_COLOURS[4], ERROR_COLOURS[5]
    assert [tuple(c) for c in picture] == [within, beyond, within, beyond]


def test_missing_disparity_is_white_and_missing_truth_dark():
    picture = error_picture(row(NAN, NAN, NAN, NAN, 5.0), row(10, NAN, NAN, NAN, NAN))[0]
    assert tuple(picture[0]) == (255, 255, 255)
    assert tuple(picture[1]) == (255, 255, 255)  # the neighbour of a known pixel is filled
    assert [tuple(c) for c in picture[2:]] == [NOTHING] * 3


def test_known_errors_are_never_painted_over():
    estimate, truth = row(10, 40, 10), row(10, 10, 10)
    colours = [tuple(c) for c in error_picture(estimate, truth)[0]]
    assert colours[0] == colours[2] == ERROR_COLOURS[0]
    assert colours[1] in ERROR_COLOURS[5:]


def test_top_view_is_dark_where_nothing_is_and_brighter_with_more():
    counts = np.array([[0, 1, 50]], np.uint16)
    nothing, few, many = top_picture(counts)[0].astype(int)
    assert tuple(nothing) == NOTHING
    assert tuple(few) != tuple(many) != NOTHING


def test_thicker_repeats_pixels():
    picture = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    big = thicker(picture, 3)
    assert big.shape == (6, 6, 3)
    np.testing.assert_array_equal(big[1::3, 1::3], picture)
