import numpy as np

from pseudolidar.geometry.beams import hdl64


def test_hdl64_has_two_blocks_of_32_lasers() -> None:
    elevations = np.array(hdl64().elevations_deg)
    assert len(elevations) == 64
    np.testing.assert_allclose(elevations[[0, 31, 32, 63]], [2.0, -8.33, -8.87, -24.33])
    spacing = -np.diff(elevations)
    np.testing.assert_allclose(spacing[:31], 1 / 3, atol=2e-3)
    np.testing.assert_allclose(spacing[32:], 1 / 2, atol=2e-3)
    np.testing.assert_allclose(spacing[31], 0.54, atol=1e-9)


def test_directions_are_unit_and_turn_left_from_ahead() -> None:
    table = hdl64(azimuth_step_deg=1.0)
    directions = table.directions().reshape(64, 360, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(np.arcsin(directions[5, :, 2])), table.elevations_deg[5])
    ahead, left = directions[0, 0], directions[0, 90]
    assert ahead[0] > 0.99
    assert abs(ahead[1]) < 1e-12
    assert left[1] > 0.99


def test_a_turn_has_as_many_points_as_the_sensor_fires() -> None:
    # 360 / 0.1728 degrees: 2083 firings of 64 lasers, about 1.3 million points a second at 10 Hz.
    assert len(hdl64().directions()) == 64 * 2083
