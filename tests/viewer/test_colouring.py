"""Colours of points, and the bars that say what they mean."""

import numpy as np
import pytest

from pseudolidar.evaluation.comparison.error_cloud import signed_colours
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer import colouring
from pseudolidar.viewer.colouring import PLAIN, Colouring, ways
from pseudolidar.viewer.thinned import thinned

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


def test_errors_are_white_in_the_middle_and_both_ends_are_as_far():
    error_m = np.array([-2.0, 0.0, 2.0, np.nan], np.float32)
    points = PointCloud(np.ones((4, 3), np.float32), "map", extra={"error_m": error_m})
    settled = Colouring("error").settled(points)
    assert settled.low == -settled.high
    near, right, far, unknown = settled.colours(points).astype(int)
    assert near[2] > near[0] + 100  # blue
    assert far[0] > far[2] + 100  # red
    assert right.min() > 200
    assert unknown.max() < 100
    scale = settled.scale()
    assert scale is not None
    assert scale.signed
    bar = scale.picture().astype(int)
    assert bar[0, 128].min() > 200
    assert bar[0, 0, 2] > bar[0, 0, 0]


def test_both_ends_of_a_scale_of_errors_are_full_wherever_they_are():
    error_m = np.array([-1.0, -0.5, 2.0, 4.0], np.float32)
    points = PointCloud(np.ones((4, 3), np.float32), "map", extra={"error_m": error_m})
    shown = Colouring("error", -1.0, 4.0).colours(points)
    assert np.array_equal(shown, signed_colours(np.array([-1.0, -0.5, 0.5, 1.0])))


def test_errors_of_clouds_that_are_not_judged_yet_are_dimmed():
    white = np.full((3, 3), 255, np.uint8)
    colours = Colouring("error").colours(cloud(rgb=white))
    assert 0 < colours.max() < 128
    assert "error" in ways(cloud(), judged=True)
    assert "error" not in ways(cloud())


def test_points_that_tell_are_drawn_first():
    error_m = np.full(10_000, np.nan, np.float32)
    error_m[::20] = 0.5
    many = PointCloud(np.ones((10_000, 3), np.float32), "map", extra={"error_m": error_m})
    drawn = thinned(many, 1000, Colouring("error").telling(many))
    assert len(drawn) == 1000
    assert np.isfinite(drawn.extra["error_m"]).sum() == 500
    few = thinned(many, 100, Colouring("error").telling(many))
    assert np.isfinite(few.extra["error_m"]).sum() == 75
    assert Colouring("range").telling(many) is None


def test_a_plain_cloud_has_a_colour_of_its_own():
    assert Colouring("plain", colour=(1, 2, 3)).colours(cloud()).tolist() == [[1, 2, 3]] * 3


def test_ends_that_are_known_are_not_looked_for(monkeypatch):
    """Of a million points that would be done with every frame."""
    monkeypatch.setattr(colouring, "_values", None)
    settled = Colouring("height", 0.0, 1.0)
    assert settled.settled(PointCloud(np.zeros((3, 3)), "map")) is settled
