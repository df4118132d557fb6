"""Points followed through rendered pictures, whose motion is known exactly."""

import numpy as np
import pytest

from pseudolidar.geometry.corners import spread_corners
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.lucas_kanade import follow, follow_both_ways
from pseudolidar.geometry.pnp import TRACK_SIGMA_PX, linearised
from pseudolidar.geometry.tracking import MatchedPair, precise_pose, relative_pose, track_warped
from pseudolidar.sources.synthetic import Synthetic

STEP_M = 0.8  # a street at 8 m/s


@pytest.fixture(scope="module")
def street():
    source = Synthetic("street", frames=3, seed=1, width_px=800).open()
    frames = [source.load(i) for i in (0, 1, 2)]
    pairs = [MatchedPair.of(frame, frame.truth) for frame in frames]
    T_map_left = [(f.pose @ left_in_base_link(f.rig)).matrix for f in frames]
    return source.rig, pairs, T_map_left


def test_the_motion_of_a_street_from_nothing(street):
    rig, pairs, T_map_left = street
    T = np.linalg.inv(T_map_left[1]) @ T_map_left[0]
    rough = relative_pose(pairs[0], pairs[1], rig, np.eye(4))
    assert rough.distance_m == pytest.approx(STEP_M, rel=0.1)
    fine = precise_pose(pairs[0], pairs[1], rig, rough.T_to_from)
    # some hundreds of tracks of 0.25 px at 6 to 60 m: millimetres
    assert np.allclose(fine.T_to_from[:3, 3], T[:3, 3], atol=0.01)
    assert np.allclose(fine.T_to_from[:3, :3], T[:3, :3], atol=5e-4)
    assert len(fine.tracks) > len(rough.tracks)


def test_warped_pictures_give_tracks_over_longer_steps(street):
    rig, pairs, T_map_left = street
    T = np.linalg.inv(T_map_left[2]) @ T_map_left[0]
    rough = T.copy()
    rough[2, 3] += 0.05  # as wrong as two chained steps are
    seen = track_warped(pairs[0], pairs[2], rig, rough)
    assert len(seen) > 200
    error = np.abs(linearised(T, seen, rig).error)
    assert np.all(np.median(error, axis=0) < TRACK_SIGMA_PX)


def test_pictures_without_texture_have_no_motion(street):
    rig, pairs, _ = street
    grey = np.full_like(pairs[0].left, 128)
    empty = MatchedPair(grey, grey, pairs[0].disparity)
    assert relative_pose(empty, empty, rig, np.eye(4)) is None
    assert relative_pose(pairs[0], empty, rig, np.eye(4)) is None


def test_nothing_matched_is_no_motion(street):
    rig, pairs, _ = street
    blind = MatchedPair(pairs[0].left, pairs[0].right, np.full_like(pairs[0].disparity, np.nan))
    assert relative_pose(blind, pairs[1], rig, np.eye(4)) is None
    assert precise_pose(blind, pairs[1], rig, np.eye(4)) is None


def test_corners_are_spread_over_the_picture(street):
    _, pairs, _ = street
    uv = spread_corners(pairs[0].left, per_cell=3)
    assert len(spread_corners(np.full((100, 300), 7, np.uint8), per_cell=3)) == 0
    height, width = pairs[0].left.shape
    side_px = round((height * width / 160) ** 0.5)
    cells, counts = np.unique(uv // side_px, axis=0, return_counts=True)
    assert counts.max() == 3
    assert len(cells) > 100
    assert np.all(uv >= 12)


def test_points_are_found_to_a_fraction_of_a_pixel_and_wrong_ones_told():
    v, u = np.indices((80, 160))
    rng = np.random.default_rng(2)
    waves = rng.uniform(0.15, 0.6, (30, 2)) * rng.choice([-1, 1], (30, 2))

    def picture(du, dv):
        light = sum(np.cos(a * (u - du) + b * (v - dv) + i) for i, (a, b) in enumerate(waves))
        return np.clip(128 + 8 * light, 0, 255).astype(np.uint8)

    there = np.array([[40.0, 40.0], [80.0, 30.0], [120.0, 50.0]], np.float32)
    first, second = picture(0, 0), picture(2.3, -1.6)
    found, good = follow_both_ways(
        first, second, there, there, window_px=21, levels=2, within_px=0.3
    )
    assert good.all()
    assert np.allclose(found - there, (2.3, -1.6), atol=0.05)
    other = rng.integers(0, 255, first.shape, dtype=np.uint8)
    _, good = follow_both_ways(first, other, there, there, window_px=21, levels=2, within_px=0.3)
    assert not good.any()
    none, found = follow(first, second, there[:0], there[:0], window_px=21)
    assert (len(none), len(found)) == (0, 0)
