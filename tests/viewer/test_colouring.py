"""Colours of points, and the bars that say what they mean."""

import numpy as np
import pytest

from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.colouring import PLAIN, Colouring, ways

XYZ = np.array([[3, 4, 0], [0, 0, 1], [6, 8, 2]], np.float32)


def cloud(**columns: object) -> PointCloud:
    return PointCloud(XYZ, "velodyne", **columns)  # type: ignore[arg-type]


def test_ways_are_what_the_cloud_knows():
    assert ways(cloud()) == ("height", "range", "plain")
    full = cloud(
        rgb=np.zeros((3, 3), np.uint8),
        sigma_m=np.ones(3, np.float32),
        intensity=np.ones(3, np.float32),
        extra={"object": np.array([0, 1, 2]), "time_s": np.zeros(3), "error_m": np.zeros(3)},
    )
    assert set(ways(full)) == {
        "photo", "height", "range", "sigma", "error", "intensity", "object", "time", "plain",
    }  # fmt: skip


def test_photo_is_the_colour_of_the_picture():
    rgb = np.arange(9, dtype=np.uint8).reshape(3, 3)
    assert np.array_equal(Colouring("photo").colours(cloud(rgb=rgb)), rgb)


def test_near_is_blue_and_far_is_red():
    colours = Colouring("range", 1.0, 10.0).colours(cloud()).astype(int)
    assert colours[2, 0] > colours[2, 2]  # range 10
    assert colours[1, 2] > colours[1, 0] or colours[1].sum() < 150  # range 1: dark blue
    assert np.abs(colours[0] - colours[1]).sum() > 60


def test_the_ends_suit_the_first_cloud_and_stay():
    many = PointCloud(np.column_stack([np.linspace(0, 100, 1001)] * 3).astype(np.float32), "map")
    settled = Colouring("height").settled(many)
    assert settled.low == pytest.approx(2, abs=0.2)
    assert settled.high == pytest.approx(98, abs=0.2)
    assert settled.settled(cloud()) == settled
    scale = settled.scale()
    assert scale is not None
    assert scale.text == "2 - 98 m"
    assert scale.picture().shape == (14, 256, 3)


def test_a_flat_cloud_and_one_without_points_have_a_scale():
    for points in (np.zeros((4, 3), np.float32), np.zeros((0, 3), np.float32)):
        settled = Colouring("height").settled(PointCloud(points, "map"))
        assert settled.high > settled.low
        assert settled.colours(PointCloud(points, "map")).shape == (len(points), 3)


def test_nan_has_a_colour():
    colours = Colouring("sigma", 0.0, 1.0).colours(
        cloud(sigma_m=np.array([np.nan, 0.1, np.inf], np.float32))
    )
    assert colours.shape == (3, 3)


def test_objects_have_colours_of_their_own_and_the_rest_has_none():
    numbers = np.array([0, 1, 2])
    colours = Colouring("object").colours(cloud(extra={"object": numbers}))
    assert tuple(colours[0]) == PLAIN
    assert not np.array_equal(colours[1], colours[2])
    more = Colouring("object").colours(
        PointCloud(np.zeros((60, 3), np.float32), "map", extra={"object": np.arange(1, 61)})
    )
    assert len({tuple(colour) for colour in more}) > 50


def test_what_a_cloud_does_not_know_is_plain():
    assert (Colouring("sigma").colours(cloud()) == PLAIN).all()
    assert (Colouring("object").colours(cloud()) == PLAIN).all()
