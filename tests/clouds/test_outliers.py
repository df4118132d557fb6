"""Points with few others around them go, by a radius that grows with distance and error."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pseudolidar.cli import main
from pseudolidar.clouds.outliers import Lonely
from pseudolidar.errors import StereoConfig
from pseudolidar.formats.points.pcd import read_pcd, write_pcd
from pseudolidar.structures.cloud import PointCloud


def wall_and_strays(distance_m, *, organised=False, sigma=None):
    """A wall of points 0.7 % of the distance apart, and every 50th moved 2 m towards the sensor."""
    step = np.arange(-20, 20) * 0.007 * distance_m
    y, z = (a.ravel() for a in np.meshgrid(step, step))
    xyz = np.stack([np.full(len(y), float(distance_m)), y, z], axis=1)
    stray = np.arange(len(xyz)) % 50 == 7
    xyz[stray, 0] -= 2.0
    cloud = PointCloud(
        xyz.astype(np.float32),
        "velodyne",
        intensity=np.arange(len(xyz), dtype=np.float32),
        sigma_m=None if sigma is None else np.full(len(xyz), sigma, np.float32),
        shape=(40, 40) if organised else None,
    )
    return cloud, stray


@pytest.mark.parametrize("distance_m", [5, 20, 60])
def test_strays_go_at_every_distance_and_all_else_stays(distance_m):
    cloud, stray = wall_and_strays(distance_m)
    left, figures = Lonely().load()(cloud, ())
    assert np.array_equal(left.intensity, cloud.intensity[~stray])
    assert figures == {"points_removed_as_outliers": stray.sum()}


def test_an_organised_cloud_keeps_its_shape():
    cloud, stray = wall_and_strays(20, organised=True)
    left, figures = Lonely().load()(cloud, ())
    assert left.shape == (40, 40)
    assert np.array_equal(~left.valid, stray)
    assert figures["points_removed_as_outliers"] == stray.sum()


def test_unsure_points_look_farther_around():
    cloud, _ = wall_and_strays(20, sigma=2.5)
    assert len(Lonely().load()(cloud, ()).cloud) == len(cloud)
    assert len(Lonely(sigmas=0).load()(cloud, ()).cloud) < len(cloud)


def test_the_same_points_as_by_a_tree():
    rng = np.random.default_rng(4)
    xyz = rng.uniform(-30, 30, (3000, 3))
    xyz[:1500] *= 0.1
    cloud = PointCloud(xyz, "velodyne")
    tool = Lonely(neighbours=2, radius_rel=0.05, min_radius_m=0.3)
    radius = np.maximum(0.3, 0.05 * np.linalg.norm(xyz, axis=1))
    count = cKDTree(xyz).query_ball_point(xyz, radius, return_length=True)
    assert np.array_equal(tool.load()(cloud, ()).cloud.xyz, xyz[count - 1 >= 2])


def test_recorded_clouds_are_cleaned_when_asked(tmp_path):
    (tmp_path / "in").mkdir()
    cloud, stray = wall_and_strays(20)
    write_pcd(tmp_path / "in" / "a.pcd", cloud)
    for flags, points in ((["--outliers", "lonely"], len(cloud) - stray.sum()), ([], len(cloud))):
        out = tmp_path / str(points)
        assert main(["convert", str(tmp_path / "in"), str(out), *flags]) == 0
        assert len(read_pcd(out / "pcd" / "a.pcd")) == points


@pytest.mark.parametrize("wrong", [{"neighbours": 0}, {"radius_rel": -1.0}, {"sigmas": -1.0}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(StereoConfig, match=next(iter(wrong))):
        Lonely(**wrong)
