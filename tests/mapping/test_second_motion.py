"""Which of several motions is the camera's: by what a camera can do, and by what agrees with it."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.pnp import RelativePose
from pseudolidar.geometry.tracking import Seeds
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.mapping.registration import LEAST_SECOND, _another
from pseudolidar.mapping.second_motion import (
    CELL_PX,
    Expected,
    camera_motion,
    cells,
    extent_m,
    left_over,
)
from pseudolidar.structures.point_tracks import PointTracks
from tests.moving_rig import rig

RIG = rig()


def motion(uv, depth_m, *, forward_m=0.0, yaw_rad=0.0, weight=1.0) -> RelativePose:
    """Tracks at pixels (N, 2) and depths (N,) or one, all of one weight."""
    uv = np.asarray(uv, np.float64)
    d = np.broadcast_to(RIG.fB_px_m / np.asarray(depth_m, np.float64), len(uv)).copy()
    T = exp_twist(np.array([0, 0, -forward_m, 0, yaw_rad, 0]))
    return RelativePose(T, np.eye(6), PointTracks(uv, d, uv, d), np.full(len(uv), weight))


def grid(columns: int, rows: int, *, step_px: float) -> np.ndarray:
    u, v = np.meshgrid(np.arange(columns), np.arange(rows))
    return step_px * np.stack([u.ravel(), v.ravel()], axis=1)


def test_the_world_is_larger_than_what_moves_in_it_however_many_corners_that_has():
    bus = motion(grid(20, 10, step_px=15), 10.0)
    street = motion(grid(6, 6, step_px=15), np.linspace(10, 60, 36), forward_m=1.0)
    assert cells(bus) > cells(street)
    assert extent_m(street, RIG) > 1.5 * extent_m(bus, RIG)
    assert camera_motion([bus, street], None, RIG) is street


def test_of_parts_alike_the_larger_part_of_the_picture_decides_and_not_its_texture():
    # twice as many corners in two cells, against 25
    dense = motion(grid(20, 10, step_px=CELL_PX / 10), np.tile(np.linspace(10, 40, 10), 20))
    wide = motion(grid(10, 10, step_px=CELL_PX / 2), np.tile(np.linspace(10, 40, 10), 10))
    sizes_m = [extent_m(one, RIG) for one in (dense, wide)]
    assert max(sizes_m) < 1.5 * min(sizes_m)
    assert camera_motion([dense, wide], None, RIG) is wide


def test_a_cell_with_one_point_says_nothing():
    assert cells(motion(grid(5, 4, step_px=CELL_PX), 10.0)) == 0
    assert cells(motion(np.repeat(grid(5, 4, step_px=CELL_PX), 2, axis=0), 10.0)) == 20
    assert cells(motion(grid(9, 9, step_px=3), 10.0, weight=0.4)) == 0


@pytest.mark.parametrize(("forward_m", "yaw_rad"), [(1.5, 0.0), (1.0, 0.15)])
def test_what_no_camera_does_is_not_its_motion_unless_nothing_else_is_seen(forward_m, yaw_rad):
    expected = Expected(motion([(0, 0)], 10.0, forward_m=1.0).T_to_from, seconds=0.1)
    wide = motion(
        grid(10, 8, step_px=40), np.linspace(5, 60, 80), forward_m=forward_m, yaw_rad=yaw_rad
    )
    slower = motion(grid(6, 6, step_px=15), 10.0, forward_m=0.95)
    assert camera_motion([wide, slower], None, RIG) is wide
    assert camera_motion([wide, slower], expected, RIG) is slower
    assert camera_motion([wide], expected, RIG) is wide
    # In a longer time it may well do so.
    longer = Expected(expected.T_to_from, seconds=0.3)
    assert camera_motion([wide, slower], longer, RIG) is wide


def test_what_goes_on_as_before_is_not_the_cameras_for_that():
    expected = Expected(np.eye(4), seconds=0.1)
    car = motion(grid(6, 6, step_px=15), 10.0)
    street = motion(grid(10, 8, step_px=40), np.linspace(5, 60, 80), forward_m=0.05)
    assert expected.comes_true(car)
    assert not expected.comes_true(street)
    assert camera_motion([car, street], expected, RIG) is street


def test_a_thing_is_as_large_as_eight_tenths_of_its_points_span():
    row = grid(101, 1, step_px=4)
    assert extent_m(motion(row, 10.0), RIG) == pytest.approx(0.8 * 400 * 10 / RIG.left.K[0, 0])


def test_at_a_high_rate_predictions_may_be_off_by_what_they_usually_are():
    expected = Expected(np.eye(4), seconds=0.001)
    assert expected.allows(motion([(0, 0)], 10.0, forward_m=0.004))
    assert not expected.allows(motion([(0, 0)], 10.0, forward_m=0.006))


def test_corners_are_left_that_agree_with_no_motion():
    uv = grid(4, 1, step_px=50).astype(np.float32) + np.float32(0.1)
    seeds = Seeds(uv, np.full(4, 20.0))
    one, other = motion(uv[:2], 10.0), motion(uv[1:3], 10.0)
    doubted = motion(uv[3:], 10.0, weight=0.4)
    np.testing.assert_array_equal(left_over(seeds, [one, other, doubted]).uv, uv[3:])
    assert len(left_over(seeds, [])) == 4


def test_another_motion_has_enough_points_and_is_none_of_those_known():
    uv = grid(LEAST_SECOND, 1, step_px=10)
    one, far = motion(uv, 10.0), motion(uv, 10.0, forward_m=0.5)
    assert _another(one, []) == [one]
    assert _another(motion(uv[1:], 10.0), []) == []
    assert _another(far, [one]) == [far]
    assert _another(motion(uv, 20.0, forward_m=0.5), [one, far]) == []
    assert _another(None, [one]) == []


def test_a_motion_that_no_point_agrees_with_is_told_as_it_is():
    vague = motion(grid(9, 9, step_px=20), 10.0, weight=0.3)
    assert extent_m(vague, RIG) == 0
    assert camera_motion([vague], None, RIG) is vague
