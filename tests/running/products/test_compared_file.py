from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.evaluation.compared import against_scan
from pseudolidar.running.products.compared_file import (
    compared_name,
    encode_compared,
    read_compared,
)
from pseudolidar.structures.camera import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from tests.evaluation.test_lidar import HEIGHT_PX, WIDTH_PX, frame, wall

CORRECTION = DisparityCorrection(np.linspace(-0.3, 0.4, 10), 0.21, "test")


@pytest.mark.parametrize("rich", [True, False])
def test_a_frame_comes_back_as_it_was(tmp_path, rich):
    bare = frame()
    pair = replace(bare, rig=bare.rig.with_correction(CORRECTION)) if rich else bare
    sigma = np.full((HEIGHT_PX, WIDTH_PX), 0.4, np.float32) if rich else None
    compared = against_scan(DisparityMap(wall(slice(0, 30)).values, sigma), pair)
    place = np.array([1.5, -2.0, 0.25])
    compared = replace(compared, id="000007_10", place_m=place if rich else None)
    path = tmp_path / compared_name(compared.id)
    path.parent.mkdir()
    path.write_bytes(encode_compared(compared))
    back = read_compared(tmp_path, compared.id)
    assert (back.id, back.index, back.timestamp_ns) == ("000007_10", 0, compared.timestamp_ns)
    for name in ("u", "v", "reference_m", "disparity_px", "slope", "depth_m", "reference_px"):
        np.testing.assert_array_equal(getattr(back, name), getattr(compared, name))
    for name in ("sigma_px", "total_sigma_px", "place_m"):
        kept, was = getattr(back, name), getattr(compared, name)
        assert (kept is None) == (was is None) == (not rich)
        if rich:
            np.testing.assert_array_equal(kept, was)
    assert encode_compared(back) == encode_compared(compared)
