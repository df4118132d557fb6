"""Which laser measured which point, in files in the order of KITTI's and in any other."""

import numpy as np
import pytest

from pseudolidar.geometry.beams import hdl64
from pseudolidar.geometry.lasers import lasers_of, scan_of_beams
from pseudolidar.structures.frame import LidarScan

TABLE = hdl64(1.0)
AZIMUTHS = 360


def turn(*, lost=0.3, seed=1, height_m=0.0):
    """A scan with lost echoes and the laser of each point, in the order of a file."""
    rng = np.random.default_rng(seed)
    laser = np.repeat(np.arange(64), AZIMUTHS)
    xyz = TABLE.directions() * rng.uniform(3, 60, (len(laser), 1)) + [0, 0, height_m]
    kept = rng.random(len(laser)) >= lost
    return xyz[kept].astype(np.float32), laser[kept]


@pytest.mark.parametrize("height_m", [0.0, 0.1])
def test_files_laser_by_laser_are_told_by_their_turns(height_m):
    """Exactly, although a laser off the origin sees other elevations near than far."""
    xyz, laser = turn(height_m=height_m)
    np.testing.assert_array_equal(lasers_of(xyz), laser)


def test_other_orders_are_told_by_elevation():
    xyz, laser = turn()
    order = np.random.default_rng(2).permutation(len(xyz))
    np.testing.assert_array_equal(lasers_of(xyz[order]), laser[order])


def test_fewer_beams_are_those_of_some_lasers_with_all_columns():
    xyz, laser = turn()
    reflectance = np.arange(len(xyz), dtype=np.float32)
    scan = LidarScan(xyz, reflectance, 5, point_times_ns=np.arange(len(xyz)))
    for beams, lasers in ((4, [8, 24, 40, 56]), (16, list(range(2, 64, 4)))):
        fewer = scan_of_beams(scan, beams)
        rows = np.flatnonzero(np.isin(laser, lasers))
        np.testing.assert_array_equal(fewer.reflectance, reflectance[rows])
        np.testing.assert_array_equal(fewer.xyz, xyz[rows])
        np.testing.assert_array_equal(fewer.point_times_ns, rows)
        assert fewer.timestamp_ns == 5
    assert scan_of_beams(scan, 64) is scan
    sixteen = scan_of_beams(scan, 16)
    assert scan_of_beams(sixteen, 16) is sixteen


def test_level_beams_are_next_to_the_horizon():
    xyz, _ = turn()
    fewer = scan_of_beams(LidarScan(xyz), 4, pattern="level").xyz
    elevation = np.degrees(np.arctan2(fewer[:, 2], np.hypot(fewer[:, 0], fewer[:, 1])))
    found = np.unique(np.round(elevation, 1))
    np.testing.assert_allclose(found[::-1], [0, -0.8, -1.6, -2.4], atol=0.21)


def test_a_scan_without_points():
    empty = LidarScan(np.empty((0, 3), np.float32))
    assert len(lasers_of(empty.xyz)) == 0
    assert scan_of_beams(empty, 4) is empty
