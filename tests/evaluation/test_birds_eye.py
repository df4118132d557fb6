"""The cloud from above: where points land, in which colour."""

import numpy as np
import pytest

from pseudolidar.evaluation.birds_eye import birds_eye, nice_length, round_length
from pseudolidar.evaluation.pictures import NOTHING
from pseudolidar.structures.cloud import PointCloud

HOW = {"side_px": 200, "all_round": False, "colour": "photo", "heights_m": (0.0, 10.0)}


def seen(points, rgb=None, **how):
    xyz = np.array(points, np.float32).reshape(-1, 3)
    colours = None if rgb is None else np.array(rgb, np.uint8).reshape(-1, 3)
    cloud = PointCloud(xyz, "base_link", rgb=colours)
    return birds_eye(cloud, **(HOW | {"ahead_m": 40.0} | how))


def coloured(picture, empty):
    """Rows and columns that differ from a picture without points."""
    return np.argwhere((picture != empty).any(axis=2))


@pytest.mark.parametrize(
    ("point", "row", "column"),
    [
        ((30, 0, 0), 50, 100),
        ((10, 15, 0), 150, 25),
        ((10, -15, 0), 150, 175),
        ((1, 0.1, 0), 195, 99),
    ],
)
def test_ahead_is_up_and_left_is_left(point, row, column):
    found = coloured(seen([point], [255, 0, 0]), seen([]))
    assert len(found)
    assert np.abs(found - (row, column)).max() <= 2


def test_all_round_the_sensor_is_in_the_middle():
    picture = seen([(-20, 0, 0)], [255, 0, 0], all_round=True)
    found = coloured(picture, seen([], all_round=True))
    assert np.abs(found - (150, 100)).max() <= 2


def test_points_outside_and_unknown_ones_are_left_out():
    points = [(-1, 0, 0), (41, 0, 0), (10, 21, 0), (10, -21, 0), (np.nan, 0, 0), (5, np.inf, 0)]
    assert np.array_equal(seen(points, [[255, 0, 0]] * 6), seen([]))


def test_points_of_one_place_are_mixed_and_dark_ones_stay_visible():
    red = seen([(20, 10, 0)] * 2, [[200, 0, 0], [100, 0, 0]])[100, 50]
    assert red[0] == round(48 + 150 * 207 / 255)
    assert (seen([(20, 10, 0)], [0, 0, 0])[100, 50] > np.array(NOTHING) + 15).all()


def test_height_is_blue_to_red_where_there_are_no_colours():
    low, high = seen([(20, 10, 0.5)])[100, 50], seen([(20, 10, 9.5)])[100, 50]
    assert low[2] > low[0]
    assert high[0] > high[2]
    forced = seen([(20, 10, 9.5)], [0, 255, 0], colour="height")[100, 50]
    assert np.array_equal(forced, high)


def test_round_lengths():
    assert [nice_length(x) for x in (0.13, 1, 4.9, 5, 20, 99)] == [0.1, 1, 2, 5, 20, 50]
    assert [round_length(x) for x in (0.9, 1, 1.2, 7, 79, 80, 81)] == [1, 1, 1.5, 8, 80, 80, 100]
