import dataclasses

import numpy as np
import pytest

from pseudolidar.errors import LowTexture, PairIdentical
from pseudolidar.running.frame_checks import MIN_DENSITY, check_pair, check_texture
from pseudolidar.structures.disparity import DisparityMap


def test_the_same_image_twice_is_refused(texture_source):
    frame = texture_source(1).load(0)
    check_pair(frame)
    with pytest.raises(PairIdentical, match="frame 000000"):
        check_pair(dataclasses.replace(frame, right=frame.left.copy()))


def test_one_pixel_makes_it_another_image(texture_source):
    frame = texture_source(1).load(0)
    other = frame.left.copy()
    other[0, 0] ^= 1
    check_pair(dataclasses.replace(frame, right=other))


def test_almost_nothing_matched_is_refused(texture_source):
    frame = texture_source(1).load(0)
    values = np.full(frame.left.shape, np.nan, np.float32)
    enough = int(np.ceil(MIN_DENSITY * values.size))
    values.flat[: enough - 1] = 5
    with pytest.raises(LowTexture, match=r"1\.9.% of the pixels"):
        check_texture(frame, DisparityMap(values.copy()))
    values.flat[:enough] = 5
    check_texture(frame, DisparityMap(values))
