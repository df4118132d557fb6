from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.thinning import thinned
from pseudolidar.structures.cloud import PointCloud

F_PX, HEIGHT_M = 700.0, 1.6


def street(*, sigma: bool = True, uv: bool = True) -> PointCloud:
    """A ground plane as a camera of 600x200 px sees it: every pixel a point, 5.6 m to 112 m."""
    v, u = np.mgrid[10:200, 0:600].reshape(2, -1)
    z = F_PX * HEIGHT_M / v
    xyz = np.stack([(u - 300) * z / F_PX, np.full_like(z, HEIGHT_M), z], axis=1)
    return PointCloud(
        xyz.astype(np.float32),
        "camera_left",
        sigma_m=(z**2 / 400).astype(np.float32) if sigma else None,
        uv=np.stack([u, v], axis=1).astype(np.float32) if uv else None,
        extra={"number": np.arange(len(z))},
    )


@pytest.mark.parametrize("most", [0, 1, 1000, 30_000, 113_999])
def test_exactly_so_many_stay_in_their_order_with_their_columns(most: int) -> None:
    cloud = street()
    few = thinned(cloud, most)
    number = few.extra["number"]
    assert len(few) == most
    assert (np.diff(number) > 0).all()
    np.testing.assert_array_equal(few.xyz, cloud.xyz[number])
    np.testing.assert_array_equal(few.uv, cloud.uv[number])


def test_a_cloud_that_is_small_enough_is_left_as_it_is() -> None:
    cloud = street()
    assert thinned(cloud, len(cloud)) is cloud


@pytest.mark.parametrize("uv", [True, False])
@pytest.mark.parametrize("sigma", [True, False])
def test_far_points_stay_and_chances_grow_with_the_square_of_range(sigma: bool, uv: bool) -> None:
    cloud = street(sigma=sigma, uv=uv)
    kept = np.zeros(len(cloud), bool)
    kept[thinned(cloud, 30_000).extra["number"]] = True
    range_m = np.linalg.norm(cloud.xyz, axis=1)
    share = [kept[(range_m > r) & (range_m < 1.1 * r)].mean() for r in (6.0, 8.0, 12.0, 60.0)]
    assert share[3] == 1
    # Within the few percent that a band of range is wide.
    assert share[1] / share[0] == pytest.approx((8 / 6) ** 2, rel=0.1)
    assert share[2] / share[1] == pytest.approx((12 / 8) ** 2, rel=0.1)


def test_what_stays_is_spread_evenly() -> None:
    cloud = street()
    few = thinned(cloud, 20_000)
    near = (cloud.xyz[:, 2] < 8) & (np.abs(cloud.xyz[:, 0]) < 2)
    near_few = (few.xyz[:, 2] < 8) & (np.abs(few.xyz[:, 0]) < 2)
    # Points of a cell of the image vary less than by chance (Poisson: variance = mean).
    v, u = few.uv[near_few].astype(int).T[::-1] // 16
    counts = np.bincount(v * 40 + u)
    whole = np.bincount((cloud.uv[near] // 16).astype(int) @ np.array([1, 40]))
    counts = counts[whole[: len(counts)] == whole.max()]
    assert len(counts) > 20
    assert counts.var() < 0.5 * counts.mean()


def test_of_one_range_the_sure_points_stay() -> None:
    rng = np.random.default_rng(1)
    unsure = rng.random(5000) < 0.5
    xyz = np.tile(np.float32([0, 0, 10]), (5000, 1))
    sigma = np.where(unsure, 0.9, 0.1).astype(np.float32)
    few = thinned(PointCloud(xyz, "camera_left", sigma_m=sigma), 1000)
    assert np.mean(few.sigma_m > 0.5) < 0.15


def test_points_without_coordinates_or_sigma_go_first() -> None:
    xyz = np.ones((6, 3), np.float32)
    xyz[[1, 4]] = np.nan
    sigma = np.full(6, 0.1, np.float32)
    sigma[2] = np.nan
    cloud = PointCloud(xyz, "a", sigma_m=sigma, extra={"number": np.arange(6)})
    assert thinned(cloud, 3).extra["number"].tolist() == [0, 3, 5]


def test_equal_points_are_taken_from_the_first_on() -> None:
    cloud = PointCloud(np.zeros((9, 3), np.float32), "a", extra={"number": np.arange(9)})
    assert thinned(cloud, 4).extra["number"].tolist() == [0, 1, 2, 3]
