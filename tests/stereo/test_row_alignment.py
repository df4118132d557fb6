"""`--rows`: rows that differ are found by points of the pair itself, and put right."""

from __future__ import annotations

import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.geometry.grey import grey8_pair
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.stereo.census import Census
from pseudolidar.stereo.eyes import Eyes
from pseudolidar.stereo.row_alignment import RowAligned, aligned, rows_between
from pseudolidar.structures.correction import RowCorrection

# As on KITTI, where the corners are off by a pixel, px.
OFF = RowCorrection(np.array([0.3, 0.2, 0.2, 0, 0.5, 0.1, 0, -0.1, 0]), 0.0)


@pytest.fixture(scope="module")
def pair():
    return Synthetic("room", frames=1, seed=3, width_px=400).open().load(0)


@pytest.fixture(scope="module")
def moved(pair):
    """The pair with a right picture that shows everything lower by `OFF`."""
    width, height = pair.size_px
    v, u = np.indices((height, width), np.float64)
    row = v.copy()
    for _ in range(20):  # the inverse field
        row = v - OFF.offset_px(u, row, (width, height))
    right = cv2.remap(
        pair.right, u.astype(np.float32), row.astype(np.float32), cv2.INTER_LANCZOS4,
        borderMode=cv2.BORDER_REFLECT_101,
    )  # fmt: skip
    return replace(pair, right=right)


def inner(values):
    return values[8:-8, 8:-8]


def test_the_rows_that_were_put_on_are_found(moved):
    found = rows_between(*grey8_pair(moved.left, moved.right))
    width, height = moved.size_px
    error = found.field_px(width, height) - OFF.field_px(width, height)
    assert np.sqrt(np.mean(error**2)) < 0.06  # of 0.4
    assert found.residual_px < 0.2


def test_a_pair_whose_rows_agree_stays_itself(pair):
    assert aligned(pair) is pair


def test_disparities_are_those_of_the_pair_that_was_never_moved(pair, moved):
    census = Census()
    truth = census.load(min_depth_m=1.0)(pair).values
    errors = {}
    for rows in ("never", "auto"):
        found = Eyes(rows=rows).load(census, min_depth_m=1.0)(moved).values
        errors[rows] = np.nanmean(np.abs(inner(found) - inner(truth)))
    assert errors["auto"] < 0.7 * errors["never"]


def test_colours_stay_colours(moved):
    put_right = aligned(moved)
    assert put_right.left is moved.left
    assert put_right.right.shape == moved.right.shape
    assert put_right.right.dtype == moved.right.dtype


@pytest.mark.parametrize("what", ["black", "noise", "unrelated", "far off"])
def test_what_tells_nothing_is_left_alone(pair, what):
    rng = np.random.default_rng(1)
    right = {
        "black": np.zeros_like(pair.right),
        "noise": rng.integers(0, 255, pair.right.shape, np.uint8),
        "unrelated": pair.right[::-1].copy(),
        "far off": np.roll(pair.right, 30, axis=0),  # not rectified: that is for `check` to say
    }[what]
    odd = replace(pair, right=right)
    assert aligned(odd) is odd


@pytest.mark.parametrize("size", [(16, 24), (30, 40), (97, 131)])
def test_tiny_pictures_pass(size):
    rng = np.random.default_rng(2)
    left, right = (rng.integers(0, 255, size, np.uint8) for _ in range(2))
    assert rows_between(left, right) is None


def test_the_same_rows_in_any_process_and_time(moved):
    eyes = grey8_pair(moved.left, moved.right)
    first = rows_between(*eyes).coefficients
    cv2.setNumThreads(2)
    try:
        assert np.array_equal(rows_between(*eyes).coefficients, first)
    finally:
        cv2.setNumThreads(1)
    matcher = pickle.loads(pickle.dumps(Eyes().load(Census(), min_depth_m=1.0)))
    assert isinstance(matcher, RowAligned)
    assert np.array_equal(
        matcher(moved).values, Eyes().load(Census(), min_depth_m=1.0)(moved).values, equal_nan=True
    )
