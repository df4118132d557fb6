"""Pictures of obstacles: boxes where they project, near over far, labels that do not overlap."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.evaluation.free_place import Places
from pseudolidar.evaluation.obstacle_drawing import AboveView, draw_from_above, draw_in_photo
from pseudolidar.evaluation.obstacle_picture import Layout, composed, finished
from pseudolidar.evaluation.preview_picture import CAPTION_PX, Panel
from pseudolidar.formats.obstacle_words import colour_by_distance
from pseudolidar.structures.box import Detection
from tests.formats.made_obstacles import car, light, upright

K = np.array([[700.0, 0.0, 620.5], [0.0, 700.0, 172.5], [0.0, 0.0, 1.0]])


def near_colour(picture, distance_m, tolerance=40):
    """(H, W) pixels of the colour of that distance."""
    off = np.abs(picture.astype(int) - colour_by_distance(distance_m)).max(axis=2)
    return off <= tolerance


def test_corners_are_drawn_where_they_project() -> None:
    photo = np.zeros((375, 1242, 3), np.uint8)
    draw_in_photo(photo, [car()], K)
    marked = near_colour(photo, car().distance_m)
    for x, y, z in car().box.corners_m():
        u, v = round(700 * x / z + 620.5), round(700 * y / z + 172.5)
        assert marked[v - 2 : v + 3, u - 2 : u + 3].any()
    left, _, right, bottom = (round(edge) for edge in car().detection.box_px)
    assert marked[bottom - 1 : bottom + 2, left:right].any(axis=0).mean() > 0.95
    assert not marked[bottom + 40 :].any()


def test_a_box_beside_the_camera_is_cut_where_it_goes_behind_it() -> None:
    box = replace(car().box, pose=upright(1.5, 0.5, 0.5, 0.0))
    photo = np.zeros((375, 1242, 3), np.uint8)
    draw_in_photo(photo, [replace(car(), box=box, distance_m=0.3)], K)
    assert near_colour(photo, 0.3).any()


def test_the_near_one_is_drawn_over_the_far_one() -> None:
    photo = np.zeros((375, 1242, 3), np.uint8)
    far = replace(car(track=False), distance_m=60.0)
    draw_in_photo(photo, [car(), far], K)  # the same boxes
    both = np.zeros_like(photo)
    draw_in_photo(both, [far, car()], K)
    np.testing.assert_array_equal(photo, both)
    assert near_colour(photo, 20.0).sum() > 5 * near_colour(photo, 60.0, 10).sum()


def test_from_above_a_thing_is_where_it_is_and_moves_where_it_goes() -> None:
    view, empty = AboveView(600, 60.0), np.zeros((600, 600, 3), np.uint8)
    still, moving = empty.copy(), empty.copy()
    draw_from_above(still, [car(track=False)], view)
    draw_from_above(moving, [car()], view)
    rows, columns = np.nonzero(near_colour(still, 20.0))
    x, _, z = car().box.pose.translation_m
    assert abs(rows.mean() - (60 - z) * 10) < 15
    assert abs(columns.mean() - (30 + x) * 10) < 15
    # The arrow of one second ends 8.25 m nearer, right of where it began.
    end = (round((60 - z + 8.25) * 10), round((30 + x + 0.5) * 10))
    marked = near_colour(moving, 20.0)
    assert marked[end[0] - 3 : end[0] + 4, end[1] - 3 : end[1] + 4].any()
    assert not near_colour(still, 20.0)[end[0] - 3 : end[0] + 4].any()


def test_labels_never_overlap_and_stay_in_the_picture() -> None:
    rng = np.random.default_rng(1)
    places, mine = Places((640, 480)), []
    for _ in range(60):
        left, top = rng.integers(0, 560), rng.integers(150, 300)
        place = places.take((90, 33), (left, top, left + 60, top + 50))
        if place is not None:
            mine.append((*place, place[0] + 90, place[1] + 33))
    assert len(mine) > 30
    for a, b in itertools.combinations(mine, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    assert np.min(mine) >= 0
    assert np.max(np.array(mine)[:, 2]) <= 640
    assert np.max(np.array(mine)[:, 3]) <= 480


def test_a_label_spares_other_things_where_there_is_room() -> None:
    beside = (100, 100, 150, 150)
    assert Places((640, 480)).take((60, 20), beside) == (100, 78)
    assert Places((640, 480), [(90, 60, 200, 99)]).take((60, 20), beside) == (100, 152)
    assert Places((60, 20), [(0, 0, 60, 20)]).take((60, 20), (0, 0, 60, 20)) == (0, 0)
    assert Places((50, 20)).take((60, 20), beside) is None


@pytest.mark.parametrize("size_px", [(1242, 375), (640, 480), (64, 48)])
def test_the_picture_has_even_sides_and_its_parts_fit(size_px) -> None:
    layout = Layout(size_px)
    photo = np.full((size_px[1], size_px[0], 3), 90, np.uint8)
    view = np.zeros((layout.side_px, layout.side_px, 3), np.uint8)
    picture = composed(
        Panel(photo, "left"), (Panel(photo, "disparity"), Panel(photo, "depth")), Panel(view, "")
    )
    assert not picture.shape[0] % 2
    assert not picture.shape[1] % 2
    assert picture.shape[0] - layout.side_px - CAPTION_PX in (0, 1)
    again = [
        finished(picture, (car(), light()), photo_px=size_px, K=K, ahead_m=60.0, caption="a")
        for _ in range(2)
    ]
    np.testing.assert_array_equal(*again)
    assert again[0].shape == picture.shape
    assert (picture[: layout.panel_px[1], : layout.panel_px[0]] == 90).all()  # is not changed
    assert (again[0] != picture).any()


def test_an_empty_frame_has_its_caption_alone() -> None:
    picture = np.zeros((Layout((640, 480)).side_px + CAPTION_PX, 1536, 3), np.uint8)
    drawn = finished(picture, (), photo_px=(640, 480), K=K, ahead_m=60.0, caption="nothing")
    changed = np.nonzero((drawn != picture).any(axis=(1, 2)))[0]
    assert changed.min() >= Layout((640, 480)).side_px


def test_boxes_scale_with_the_photo() -> None:
    small, large = np.zeros((100, 200, 3), np.uint8), np.zeros((200, 400, 3), np.uint8)
    one = replace(car(), detection=Detection("Car", (50.0, 60.0, 90.0, 80.0)), distance_m=4.0)
    far_away = replace(one.box, pose=upright(0.0, 0.0, -50.0, 0.0))  # its edges are not in view
    for photo, scale in ((small, 1.0), (large, 2.0)):
        draw_in_photo(photo, [replace(one, box=far_away)], K, scale=scale)
    assert near_colour(small, 4.0)[80, 50:91].mean() > 0.9
    # Half a pixel each: the lower edge of pixel 80 is at 160.5 there.
    assert (large[160:162, 101:182].max(axis=(0, 2)) > 100).all()
    assert not large[150:158, 110:170].any()
