"""Errors of a frame's points: what `compare` writes at reference points, surfaces between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert, ConvertFrame, opened

from pseudolidar.evaluation.compared import against_scan
from pseudolidar.evaluation.comparison.error_cloud import (
    DIMMED,
    TOO_NEAR,
    at_pixels,
    error_cloud,
    error_colours,
    errors_m,
)
from pseudolidar.geometry.grey import rgb_of
from pseudolidar.running.products.converted import Converted
from pseudolidar.sources.synthetic import Synthetic
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.viewer.judged import compared_of, error_of_pixels, judged
from pseudolidar.viewer.moment import STEREO, Moment
from pseudolidar.viewer.pictures import kinds


@pytest.fixture(scope="module")
def converted() -> Converted:
    job = Convert(Synthetic("street", frames=1, width_px=512))
    source = opened(job)
    return ConvertFrame.of(job, source).converted(source.load(0))


def without(converted: Converted, **gone: None) -> Converted:
    assert isinstance(converted.frame, StereoFrame)
    return replace(converted, frame=replace(converted.frame, **gone))


def test_a_point_has_the_error_that_compare_writes(converted: Converted):
    moment = judged(Moment.of(converted))
    assert isinstance(converted.frame, StereoFrame)
    assert converted.disparity is not None
    written = error_cloud(
        Moment.of(converted).clouds[STEREO], against_scan(converted.disparity, converted.frame)
    ).extra["error_m"]
    shown = moment.clouds[STEREO].extra["error_m"]
    known = np.isfinite(written)
    assert known.sum() > 1000
    assert np.array_equal(shown[known], written[known])
    # Surfaces between the beams tell of many more points, about as large errors.
    more = np.isfinite(shown) & ~known
    assert more.sum() > 2 * known.sum()
    assert np.median(np.abs(shown[more])) < 2 * np.median(np.abs(written[known]))


def test_surfaces_agree_with_the_exact_truth(converted: Converted):
    exact, scanned = without(converted, scan=None), without(converted, truth=None)
    error_m, by_scan_m = error_of_pixels(exact), error_of_pixels(scanned)
    assert error_m is not None
    assert by_scan_m is not None
    both = np.isfinite(error_m) & np.isfinite(by_scan_m)
    assert both.sum() > 10_000
    off_m = np.abs(error_m - by_scan_m)[both]
    assert np.median(off_m) < 0.05  # beams are 0.4 degrees apart, with 2 cm of noise


def test_errors_at_the_pixels_of_a_scan_are_drawn_where_there_is_no_truth(converted: Converted):
    scanned, bare = without(converted, truth=None), without(converted, scan=None, truth=None)
    assert "error" in kinds(converted)
    assert "error" not in kinds(bare)
    assert scanned.disparity is not None
    drawn = kinds(scanned)["error"](scanned)
    compared = compared_of(scanned, "scan")
    assert compared is not None
    # Each pixel has the error of a scan's point at it, or at its neighbour above or on its left.
    relative = at_pixels(compared, errors_m(compared) / compared.reference_m)
    alone = np.isfinite(relative)
    beside = alone[:-1, 1:] | alone[1:, :-1] | alone[:-1, :-1]
    dots = alone.copy()
    dots[1:, 1:] |= beside
    alone[1:, 1:] &= ~beside
    assert alone.sum() > 1000
    assert np.array_equal(drawn[alone], error_colours(relative[alone]))
    # Dots are two pixels wide; beside them is the photo, darker.
    dimmed = (DIMMED * rgb_of(scanned.frame.left)).astype(np.uint8)
    assert np.mean((drawn != dimmed).any(axis=2)[dots]) > 0.99
    assert np.array_equal(drawn[1:, 1:][~dots[1:, 1:]], dimmed[1:, 1:][~dots[1:, 1:]])
    # What is 20 % too near everywhere is blue.
    disparity = replace(scanned.disparity, values=scanned.disparity.values * 1.2)
    blue = kinds(scanned)["error"](replace(scanned, disparity=disparity))[alone]
    assert np.mean((blue == TOO_NEAR).all(axis=1)) > 0.9


def test_without_a_reference_nothing_is_added(converted: Converted):
    bare = without(converted, scan=None, truth=None)
    assert error_of_pixels(bare) is None
    assert "error_m" not in judged(Moment.of(bare)).clouds[STEREO].extra
    fault = Moment("a", 0, fault="cannot be read")
    assert judged(fault).fault == fault.fault
