"""Clouds: columns stay together whatever is chosen of them."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.errors import StructureError
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose

COLUMNS = ("xyz", "rgb", "intensity", "sigma_m", "uv")
N = 24


@pytest.fixture
def cloud() -> PointCloud:
    rng = np.random.default_rng(3)
    return PointCloud(
        rng.normal(size=(N, 3)).astype(np.float32),
        "velodyne",
        5,
        rgb=rng.integers(0, 256, (N, 3), dtype=np.uint8),
        intensity=rng.random(N, np.float32),
        sigma_m=rng.random(N, np.float32),
        uv=rng.random((N, 2), np.float32),
        extra={"ring": np.arange(N, dtype=np.int16), "normal": rng.normal(size=(N, 3))},
        shape=(4, 6),
    )


@pytest.mark.parametrize(
    "index",
    [
        np.arange(N) % 3 == 0,
        np.zeros(N, np.bool_),
        np.array([7, 2, 2, -1]),
        slice(20, 3, -4),
    ],
    ids=["mask", "nothing", "positions", "slice"],
)
def test_every_column_is_indexed_as_numpy_would(cloud, index):
    chosen = cloud[index]
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(chosen, name), getattr(cloud, name)[index])
        assert getattr(chosen, name).dtype == getattr(cloud, name).dtype
    for name, column in cloud.extra.items():
        np.testing.assert_array_equal(chosen.extra[name], column[index])
    assert (chosen.frame, chosen.timestamp_ns, chosen.shape) == ("velodyne", 5, None)


@pytest.mark.parametrize("length", [N - 1, N + 1])
def test_mask_of_another_cloud_is_refused(cloud, length):
    with pytest.raises(IndexError, match="mask"):
        cloud[np.ones(length, np.bool_)]


def test_absent_columns_stay_absent():
    bare = PointCloud(np.zeros((3, 3), np.float32), "velodyne")
    chosen = bare[np.array([True, False, True])]
    assert len(chosen) == 2
    assert all(getattr(chosen, name) is None for name in COLUMNS[1:])


@pytest.mark.parametrize(
    ("changed", "where"),
    [
        ({"xyz": np.zeros((N, 3), np.int32)}, "xyz"),
        ({"rgb": np.zeros((N - 1, 3), np.uint8)}, "rgb"),
        ({"intensity": np.zeros(N)}, "intensity"),
        ({"uv": np.zeros((N, 3), np.float32)}, "uv"),
        ({"extra": {"ring": np.zeros(N + 1)}}, "ring"),
        ({"shape": (5, 6)}, "shape"),
    ],
)
def test_columns_that_do_not_fit_are_refused(changed, where):
    columns = {"xyz": np.zeros((N, 3), np.float32), "frame": "velodyne"} | changed
    with pytest.raises(StructureError) as refused:
        PointCloud(**columns)
    assert where in refused.value.where


def test_transformed_checks_the_frame_and_keeps_the_columns(cloud):
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    T_map_velodyne = Pose.from_rotation("map", "velodyne", turn, np.array([10.0, 0, 0]))
    moved = cloud.transformed(T_map_velodyne)
    assert moved.frame == "map"
    x, y, z = cloud.xyz.T
    np.testing.assert_allclose(moved.xyz, np.stack([10 - y, x, z], axis=1), atol=1e-6)
    assert moved.sigma_m is cloud.sigma_m
    with pytest.raises(StructureError):
        moved.transformed(T_map_velodyne)
