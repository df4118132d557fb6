"""Samples of two maps: where both know, evenly thinned, brought to one image size."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import StructureError
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.samples import DisparitySamples

NAN = np.nan
MEASURED = DisparityMap(
    np.array([[1, 2, NAN], [4, 5, 6]], np.float32),
    np.array([[0.1, 0.2, NAN], [0.4, 0.5, 0.6]], np.float32),
)
TRUE = DisparityMap(np.array([[1.5, NAN, 3.5], [4.5, 5.5, 6.5]], np.float32))


def test_pixels_that_both_know():
    samples = DisparitySamples.of_maps(MEASURED, TRUE, frame=7)
    np.testing.assert_array_equal(samples.measured, [1, 4, 5, 6])
    np.testing.assert_array_equal(samples.reference, [1.5, 4.5, 5.5, 6.5])
    np.testing.assert_array_equal(samples.u, [0, 0, 1, 2])
    np.testing.assert_array_equal(samples.v, [0, 1, 1, 1])
    np.testing.assert_allclose(samples.sigma, [0.1, 0.4, 0.5, 0.6], rtol=1e-6)
    assert set(samples.frame) == {7}
    assert samples.size_px == (3, 2)


@pytest.mark.parametrize(("most", "kept"), [(None, 4), (4, 4), (3, 2), (1, 1)])
def test_thinning_is_even_and_never_above_the_cap(most, kept):
    assert len(DisparitySamples.of_maps(MEASURED, TRUE, frame=0, most=most)) == kept


def test_masks_and_slices_choose_from_every_column():
    samples = DisparitySamples.of_maps(MEASURED, TRUE, frame=0)
    chosen = samples[samples.measured > 4.5]
    np.testing.assert_array_equal(chosen.u, [1, 2])
    np.testing.assert_allclose(chosen.sigma, [0.5, 0.6], rtol=1e-6)
    assert len(samples[1:]) == 3


def test_other_image_sizes_are_stretched_corner_to_corner():
    small = DisparitySamples.of_maps(MEASURED, TRUE, frame=0)
    wide = np.full((3, 5), NAN, np.float32)
    wide[2, 4] = 9.0
    large = DisparitySamples.of_maps(DisparityMap(wide), DisparityMap(wide), frame=1)
    joined = DisparitySamples.concatenate([small, large])
    assert joined.size_px == (3, 2)
    assert (joined.u[-1], joined.v[-1], joined.measured[-1]) == (2.0, 1.0, 9.0)
    assert joined.sigma is None  # the second has none
    with pytest.raises(StructureError):
        DisparitySamples.concatenate([])
