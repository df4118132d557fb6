"""Which point somebody means who clicks."""

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.picking import nearest_on_line, picked


def test_the_surface_in_front_is_meant():
    rng = np.random.default_rng(0)
    wall = np.column_stack([np.full(4000, 5.0), rng.uniform(-2, 2, (4000, 2))])
    behind = wall + np.array([3.0, 0, 0])
    xyz = np.concatenate([behind, wall]).astype(np.float32)
    index = nearest_on_line(xyz, np.zeros(3), np.array([1.0, 0.05, 0.0]) / np.hypot(1, 0.05))
    assert index is not None
    assert index >= 4000
    assert np.linalg.norm(xyz[index] - (5, 0.25, 0)) < 0.06


def test_nothing_beside_or_behind_is_meant():
    xyz = np.float32([[-5, 0, 0], [5, 1, 0]])
    assert nearest_on_line(xyz, np.zeros(3), np.array([1.0, 0, 0])) is None
    assert nearest_on_line(np.zeros((0, 3), np.float32), np.zeros(3), np.array([1.0, 0, 0])) is None


def test_of_several_clouds_the_nearest_in_the_scene_with_what_is_known_of_it():
    near = PointCloud(
        np.float32([[4, 0, 0]]),
        "velodyne",
        sigma_m=np.float32([0.1]),
        uv=np.float32([[620.0, 180.0]]),
    )
    T = np.eye(4)
    T[0, 3] = 10.0
    clouds = {"far": (near, T), "near": (near, np.eye(4))}
    found = picked(clouds, np.zeros(3), np.array([2.0, 0, 0]))
    assert found is not None
    assert found.cloud == "near"
    assert found.range_m == pytest.approx(4)
    assert found.text == "4.00, 0.00, 0.00 m; range 4.00 ± 0.10 m, pixel 620, 180"
    moved = picked({"far": (near, T)}, np.zeros(3), np.array([1.0, 0, 0]))
    assert moved is not None
    assert moved.xyz_m == pytest.approx((4, 0, 0))
