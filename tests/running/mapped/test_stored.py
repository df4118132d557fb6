"""Disparities of frames on the disk, and files that are none."""

from types import SimpleNamespace

import numpy as np
import pytest

from pseudolidar.errors import ImageUnreadable, LowTexture
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.pictures.stored_disparity import decode_disparity, encode_disparity
from pseudolidar.running.mapped.stored import MatchOnce
from pseudolidar.structures.disparity import DisparityMap
from tests.mapping.told_chain import frames_for


def some(shape: tuple[int, int] = (37, 53)) -> DisparityMap:
    rng = np.random.default_rng(3)
    values = rng.uniform(0.001, 250, shape).astype(np.float32)
    values[rng.random(shape) < 0.2] = np.nan
    sigma = np.where(np.isfinite(values), rng.uniform(0.05, 3, shape), np.nan).astype(np.float32)
    return DisparityMap(values, sigma)


def test_what_is_stored_comes_back_to_half_a_step():
    before = some()
    after = decode_disparity(encode_disparity(before))
    assert np.array_equal(np.isfinite(before.values), np.isfinite(after.values))
    known = before.valid
    far = before.values[known] > 1 / 256
    assert np.abs(before.values - after.values)[known][far].max() <= 0.5 / 256 + 1e-6
    assert after.sigma is not None
    assert np.abs(before.sigma - after.sigma)[known].max() <= 0.5 / 1024 + 1e-6


def test_what_was_stored_is_stored_the_same_again():
    data = encode_disparity(some())
    assert encode_disparity(decode_disparity(data)) == data


def test_a_cut_or_changed_file_is_refused():
    data = encode_disparity(some())
    for cut in (0, 5, 19, 40, len(data) - 1):
        with pytest.raises(ImageUnreadable):
            decode_disparity(data[:cut])
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(data), 200):
        changed = bytearray(data)
        changed[place] ^= 1 + int(rng.integers(255))
        with pytest.raises(ImageUnreadable):
            decode_disparity(bytes(changed))


def test_a_file_that_claims_too_much_is_refused():
    with pytest.raises(ImageUnreadable, match="pixels"):
        decode_disparity(encode_disparity(some()), limits=Limits(pixels=100))


def test_where_nothing_is_seen_nothing_is_looked_for(tmp_path):
    def dark(_frame):
        raise LowTexture("black", where="left")

    def never(_frame):
        raise AssertionError("looked for things in a black picture")

    (frame,) = frames_for(["black"])
    match_once = MatchOnce(SimpleNamespace(disparity=dark), tmp_path, sight=never, detect=never)
    matched = match_once(frame)
    assert matched.movable == ()
    assert not matched.disparity.valid.any()
    assert "LowTexture: black" in matched.product.figures["notes"]
