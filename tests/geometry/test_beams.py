import numpy as np
import pytest

from pseudolidar.geometry.beams import every_nth_beam, hdl64, seen_by_beams


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


def test_a_wall_is_seen_as_a_lidar_sees_it():
    """Dense points of a wall 10 m ahead keep one of each direction, the nearest."""
    y, z = np.meshgrid(np.linspace(-5, 5, 800), np.linspace(-3, 0.3, 600))
    wall = np.stack([np.full(y.size, 10.0), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    behind = wall * np.float32(1.01)
    xyz = np.concatenate([behind, wall])
    counts = []
    for beams in (64, 32, 16, 4):
        table = every_nth_beam(hdl64(), beams)
        rows = seen_by_beams(xyz, table)
        assert len(table.elevations_deg) == beams
        assert (rows >= len(wall)).all()  # nothing from behind the wall
        assert (np.diff(rows) > 0).all()
        counts.append(len(rows))
        seen = xyz[rows]
        elevation = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
        off = np.abs(elevation[:, None] - np.array(table.elevations_deg)).min(axis=1)
        assert off.max() <= 0.2501
        azimuth = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
        cells = np.stack([np.rint(azimuth / table.azimuth_step_deg), np.rint(elevation * 8)], 1)
        assert len(np.unique(cells, axis=0)) > 0.9 * len(seen)
    # About 53 degrees in steps of 0.17 by the lasers that meet the wall.
    assert counts[0] == pytest.approx(2 * counts[1], rel=0.1)
    assert counts[1] == pytest.approx(2 * counts[2], rel=0.15)
    assert counts[0] < 64 * 320


def test_what_is_out_of_range_is_not_seen():
    xyz = np.array([[0.5, 0, 0], [200.0, 0, 0], [10.0, 0, 9.0], [10.0, 0, 0.0]], np.float32)
    table = hdl64()
    assert seen_by_beams(xyz, table).tolist() == [3]
    assert seen_by_beams(xyz[:0], table).tolist() == []
