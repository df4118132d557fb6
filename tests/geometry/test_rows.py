import numpy as np
import pytest

from pseudolidar.geometry.rows import rows_aligned
from pseudolidar.structures.correction import RowCorrection

SIZE_PX = (120, 80)
TILT = RowCorrection(np.array([0.6, 0.4, -0.3, 0.2, 1.1, 0, 0, 0, 0.3]), 0.1)


def picture(lower=None):
    """Smooth stripes, each pixel `lower` px down of where it was."""
    v, u = np.indices(SIZE_PX[::-1], np.float64)
    v = v if lower is None else v - lower.offset_px(u, v, SIZE_PX)
    return 128 + 80 * np.sin(v / 3.0) + 30 * np.cos(u / 7.0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("colours", [1, 3])
def test_rows_that_were_moved_come_back(dtype, colours):
    """`v_right = v_left + offset`: what the left eye has in row v stands lower by the offset."""
    v, u = np.indices(SIZE_PX[::-1], np.float64)
    scale = 1 if dtype == np.uint8 else 200
    # moved by the inverse field, found in a few rounds
    row = v.copy()
    for _ in range(20):
        row = v - TILT.offset_px(u, row, SIZE_PX)
    moved = (128 + 80 * np.sin(row / 3.0) + 30 * np.cos(u / 7.0)) * scale
    right = np.rint(moved).astype(dtype)
    right = right if colours == 1 else np.repeat(right[:, :, None], 3, axis=2)
    back = rows_aligned(right, TILT)
    assert (back.dtype, back.shape) == (right.dtype, right.shape)
    back = back if colours == 1 else back[..., 0]
    inside = (slice(4, -4), slice(None))
    error = np.abs(back.astype(float) - picture() * scale)[inside]
    assert error.max() < 3 * scale  # rounding and cubic interpolation; 80 grey levels if not moved
    assert (
        np.abs(right.astype(float).reshape(*SIZE_PX[::-1], -1)[..., 0] - picture() * scale)[
            inside
        ].max()
        > 15 * scale
    )


def test_nothing_is_invented_beyond_the_border():
    lower = RowCorrection(np.array([-2.5, 0, 0, 0, 0, 0, 0, 0, 0]), 0.0)
    back = rows_aligned(np.full(SIZE_PX[::-1], 200, np.uint8), lower)
    assert np.all(back[:3] == 0)
    assert np.all(back[3:] == 200)


def test_a_resized_picture_has_a_scaled_correction():
    small = TILT.scaled(0.5)
    u, v = np.array([10.0, 100.0]), np.array([20.0, 70.0])
    whole = TILT.offset_px(u, v, SIZE_PX)
    # pixel centres: 0.5 px of a border lie beyond the first and last centre
    half = small.offset_px(u / 119 * 59, v / 79 * 39, (60, 40))
    assert np.allclose(half, whole / 2)
    assert small.residual_px == TILT.residual_px / 2


def test_the_whole_field_is_the_offset_of_every_pixel():
    rng = np.random.default_rng(0)
    rows = RowCorrection(rng.normal(size=9), 0.0)
    v, u = np.indices(SIZE_PX[::-1], np.float64)
    field = rows.field_px(*SIZE_PX)
    assert field.dtype == np.float32
    assert np.abs(field - rows.offset_px(u, v, SIZE_PX)).max() < 1e-5
