from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import UsageError
from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import aligning_rotations
from pseudolidar.geometry.rectified_pixels import PairMaps
from pseudolidar.geometry.virtual_views import seen_heights_deg, virtual_views
from tests.raw_rigs import raw_rig, seen_at

WIDE = raw_rig(model="fisheye", focal_px=150.0, strength=0.3)
WIDE_TURN = np.array([0.2, -0.03, 0.1])


@pytest.mark.parametrize("views", [2, 3, 5])
def test_views_cover_what_is_seen_once(views: int):
    found = virtual_views(WIDE, views)
    assert len(found) == views
    straight, other = aligning_rotations(WIDE.T_right_left)
    ends = []
    for view in found:
        K, (first, last) = view.rig.left.K, view.shown_rows
        rows = np.array([first - 0.5, last - 0.5])
        below_deg = np.rad2deg(np.arctan((rows - K[1, 2]) / K[1, 1]))
        middle = view.R_left @ straight.T
        turn_deg = np.rad2deg(np.arctan2(middle[1, 2], middle[1, 1]))
        ends.append(below_deg - turn_deg)
        assert view.rig.is_rectified
    for (_, end), (begin, _) in itertools.pairwise(ends):
        assert 0 <= end - begin < 0.8  # at most a row of each, 0.38 degrees high
    assert ends[-1][1] - ends[0][0] > 150
    highest, lowest = seen_heights_deg(WIDE, straight, other)
    assert 0 <= highest - ends[0][0] < 0.8
    assert 0 <= ends[-1][1] - lowest < 0.8


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.3, 0.0, 0.0]), WIDE_TURN])
def test_heights_are_those_that_both_lenses_see(turn: np.ndarray):
    """By OpenCV's lens; the right eye's centre is lower, so each eye ends the field on one side."""
    raw = raw_rig(model="fisheye", focal_px=190.0, strength=0.3, turn=turn)
    R_left, R_right = aligning_rotations(raw.T_right_left)
    first, last = seen_heights_deg(raw, R_left, R_right)
    angles = np.arange(-340, 341) / 4
    ahead = np.stack([0 * angles, np.sin(np.deg2rad(angles)), np.cos(np.deg2rad(angles))], axis=-1)
    rows = [seen_at(eye, ahead @ R)[:, 1] for eye, R in ((raw.left, R_left), (raw.right, R_right))]
    both = np.all([(row >= 0) & (row <= 479) for row in rows], axis=0)
    assert (first, last) == (angles[both][0], angles[both][-1])
    alone = [angles[(row >= 0) & (row <= 479)] for row in rows]
    assert alone[0][0] != alone[1][0]
    assert alone[0][-1] != alone[1][-1]


def test_points_lie_in_one_row_of_a_view_at_the_disparity_of_their_depth():
    for view in virtual_views(WIDE, 3):
        rng = np.random.default_rng(0)
        points = rng.uniform((-1.5, -0.4, 1.0), (1.5, 0.4, 4.0), (200, 3))
        in_left = points @ view.R_left
        in_right = WIDE.T_right_left.apply(in_left)
        flat = []
        for camera, R, seen in (
            (WIDE.left, view.R_left, in_left),
            (WIDE.right, view.R_right, in_right),
        ):
            lens = Lens.of(camera)
            uv, holds = lens.pixels(seen)
            assert holds.all()
            straight = lens.directions(uv) @ R.T
            flat.append(straight[:, :2] / straight[:, 2:] * view.rig.left.focal_px)
        np.testing.assert_allclose(flat[0][:, 1], flat[1][:, 1], atol=1e-6)
        depth = view.rig.fB_px_m / (flat[0][:, 0] - flat[1][:, 0])
        np.testing.assert_allclose(depth, points[:, 2], rtol=1e-8)


def test_rows_of_a_neighbour_are_masked():
    view = virtual_views(WIDE, 3)[1]
    first, last = view.shown_rows
    mask = PairMaps.of(view).mask
    assert not mask.left[:first].any()
    assert not mask.left[last:].any()
    assert mask.left[first:last].mean() > 0.9


def test_what_no_lens_saw_is_masked_in_the_rows_of_a_view_too():
    raw = raw_rig(model="fisheye", focal_px=240.0, strength=0.3)  # 155 degrees wide
    view = virtual_views(raw, 2, field_deg=165.0)[0]
    first, last = view.shown_rows
    alone = PairMaps.of(replace(view, shown_rows=None)).mask
    mask = PairMaps.of(view).mask
    for own, whole in ((mask.left, alone.left), (mask.right, alone.right)):
        assert not whole[first:last].all()
        np.testing.assert_array_equal(own[first:last], whole[first:last])


def test_width_zoom_and_field():
    plain, fine = virtual_views(WIDE, 3)[0].rig.left, virtual_views(WIDE, 3, zoom=2.0)[0].rig.left
    assert fine.focal_px == pytest.approx(2 * plain.focal_px)
    sized = virtual_views(WIDE, 3, width_px=500, field_deg=90.0)[0].rig.left
    assert sized.width_px == 500
    assert sized.focal_px == pytest.approx(250.0)


@pytest.mark.parametrize(
    ("views", "field_deg", "words"),
    [(1, 120.0, "2 or more"), (0, 120.0, "1 to 9"), (3, 179.0, "10 to 170")],
)
def test_numbers_that_make_no_picture(views: int, field_deg: float, words: str):
    with pytest.raises(UsageError, match=words):
        virtual_views(WIDE, views, field_deg=field_deg)
