"""Scans of a sensor that drives and turns, by hand and by the matrix exponential."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from pseudolidar.geometry.scan_motion import at_one_moment, raised, turning_times_ns
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose

# As seen from a place at the moment in question, m.
WORLD = np.array([[10.0, 0, 0], [0, 10, 1], [-8, 3, -1.7], [4, -30, 2], [0.5, 0.2, 0]])
SECONDS = np.array([0.05, -0.03, 0.0, 0.021, -0.05])


def motion(velocity=(0, 0, 0), rate=(0, 0, 0)) -> BodyMotion:
    return BodyMotion("velodyne", np.array(velocity, float), np.array(rate, float))


def test_driving_straight_on():
    # 0.05 s later at 20 m/s a point ahead is 1 m nearer
    seen = WORLD - np.outer(SECONDS, (20.0, 0, 0))
    assert seen[0, 0] == 9.0
    found = at_one_moment(seen, SECONDS, motion(velocity=(20, 0, 0)))
    np.testing.assert_allclose(found, WORLD, atol=2e-6)


def test_turning_left_on_the_spot():
    # after a turn to the left by a quarter what was on the left is ahead
    quarter_s = np.pi / 2 / 0.8
    found = at_one_moment(np.array([[10.0, 0, 1]]), np.array([quarter_s]), motion(rate=(0, 0, 0.8)))
    np.testing.assert_allclose(found, [[0, 10, 1]], atol=1e-5)


@pytest.mark.parametrize("rate", [(0.1, -0.2, 0.7), (1e-9, 0, 0), (0, 0, 0)])
def test_twists_as_the_matrix_exponential_has_them(rate):
    velocity = np.array([15.0, -0.4, 0.2])
    twist = np.zeros((4, 4))
    twist[:3, :3] = np.cross(np.eye(3), rate)
    twist[:3, 3] = velocity
    np.testing.assert_allclose(twist[:3, :3] @ WORLD[1], np.cross(rate, WORLD[1]), atol=1e-15)
    stood = [expm(twist * t) for t in SECONDS]  # T_moment_t
    seen = np.array(
        [np.linalg.solve(T, [*point, 1])[:3] for T, point in zip(stood, WORLD, strict=True)]
    )
    found = at_one_moment(seen, SECONDS, motion(velocity, rate))
    np.testing.assert_allclose(found, WORLD, atol=4e-6)


def test_times_by_azimuth_clockwise_from_behind():
    degrees = np.array([180.0, 90, 0, -90, -179.999])
    angle = np.deg2rad(degrees)
    xyz = np.stack([7 * np.cos(angle), 7 * np.sin(angle), np.zeros(5)], axis=1)
    times = turning_times_ns(xyz, (1_000, 101_000))
    np.testing.assert_allclose(times, [1_000, 26_000, 51_000, 76_000, 101_000], atol=1)
    assert times.dtype == np.int64


def test_beams_are_raised_by_an_angle():
    xyz = np.array([[3.0, 4, 0], [3, 4, -2], [-10, 0.1, 2], [0.1, 0, 8]])
    found = raised(xyz, np.deg2rad(0.205)).astype(float)
    ranges = [np.linalg.norm(p, axis=1) for p in (found, xyz)]
    np.testing.assert_allclose(*ranges, rtol=1e-6)

    def elevation_deg(p):
        return np.rad2deg(np.arctan2(p[:, 2], np.hypot(p[:, 0], p[:, 1])))

    np.testing.assert_allclose(elevation_deg(found) - elevation_deg(xyz), 0.205, atol=1e-4)
    azimuths = [np.arctan2(p[:, 1], p[:, 0]) for p in (found, xyz)]
    np.testing.assert_allclose(*azimuths, atol=1e-6)


def test_a_sensor_beside_the_turning_point_moves_by_the_turn():
    # the sensor stands 2 m ahead of the IMU, its x axis to the left
    R = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    T_imu_sensor = Pose.from_rotation("base_link", "velodyne", R.T, np.array([2.0, 0, 0]))
    body = BodyMotion("base_link", np.array([10.0, 0, 0]), np.array([0, 0, 0.5]))
    sensor = body.at(T_imu_sensor.inverse())
    # 10 m/s forward, which is -y of the sensor; 0.5 rad/s x 2 m to the left, its x
    np.testing.assert_allclose(sensor.velocity_m_s, (1.0, -10.0, 0), atol=1e-12)
    np.testing.assert_allclose(sensor.rate_rad_s, (0, 0, 0.5), atol=1e-12)
    assert sensor.frame == "velodyne"
