"""Round lengths, the ground, rings of range."""

from __future__ import annotations

import numpy as np
import pytest

from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.viewer.octree.chosen import Eye
from pseudolidar.viewer.scales.ground import RANGES_M, ground_below_m, rings
from pseudolidar.viewer.scales.ruler import (
    ABOVE_SHARE,
    PIECES,
    WIDTH_SHARE,
    Ruler,
    length_text,
    round_length_m,
)

FOV, WIDTH, HEIGHT = 1.2, 1200, 800


def looking(from_m: np.ndarray, at_m: np.ndarray) -> Eye:
    """An eye with its x level."""
    forward = (at_m - from_m) / np.linalg.norm(at_m - from_m)
    right = np.cross(forward, (0, 0, 1) if abs(forward[2]) < 0.999 else (1, 0, 0))
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward], axis=1)
    eye = Eye.of(
        wxyz=quaternion_wxyz(R), position_m=from_m, fov=FOV, width_px=WIDTH, height_px=HEIGHT,
        T_map_scene=np.eye(4),
    )  # fmt: skip
    assert eye is not None
    return eye


def page(eye: Eye, place: np.ndarray) -> np.ndarray:
    """Where a place is on the page, -1 to 1 across the width."""
    x, y, z = eye.R_world_eye.T @ (place - eye.position_m)
    return np.array([x, y]) / (z * np.tan(0.5 * FOV) * eye.aspect)


@pytest.mark.parametrize(
    ("most", "length"),
    [
        (1, 1),
        (1.99, 1),
        (2, 2),
        (4.9, 2),
        (5, 5),
        (9.99, 5),
        (0.3, 0.2),
        (0.005, 0.005),
        (7e3, 5e3),
    ],
)
def test_lengths_are_round(most: float, length: float):
    assert round_length_m(most) == pytest.approx(length)


def test_lengths_are_told_in_the_unit_that_people_take():
    told = [length_text(length) for length in (2000.0, 50.0, 1.0, 0.5, 0.02)]
    assert told == ["2 km", "50 m", "1 m", "50 cm", "2 cm"]


def test_the_bar_has_a_good_part_of_the_page_from_wherever_one_looks():
    rng = np.random.default_rng(0)
    for away in 10.0 ** rng.uniform(-1, 4, 200):
        at = rng.uniform(-3, 3, 3) * away
        turn, down = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.5)
        back = np.array([np.cos(turn) * np.cos(down), np.sin(turn) * np.cos(down), np.sin(down)])
        eye = looking(at + away * back, at)
        ruler = Ruler.before(eye, at, float(at[2]))
        ends = ruler.pieces[[0, -1], [0, 1]].astype(float)
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(ruler.length_m, rel=1e-3)
        across = page(eye, ends[1]) - page(eye, ends[0])
        # Of the width, which is 2 here; 1 to 2.5 between round lengths, and up to 7.5° aside.
        assert WIDTH_SHARE / 2.8 < across[0] / 2 < WIDTH_SHARE * 1.2
        assert np.abs(page(eye, np.array(ruler.middle_m))).max() < 0.1


def test_the_bar_lies_on_the_ground_in_equal_parts():
    at = np.array([12.0, 1.0, 0.0])
    ruler = Ruler.before(looking(np.array([-8.0, 0, 5]), at), at, -1.7)
    pieces = ruler.pieces
    assert pieces.shape == (PIECES, 2, 3)
    assert np.allclose(pieces[..., 2], -1.7 + ABOVE_SHARE * ruler.length_m)
    lengths = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1)
    assert lengths == pytest.approx([ruler.length_m / PIECES] * PIECES)
    assert np.array_equal(pieces[1:, 0], pieces[:-1, 1])
    assert [text for text, _ in ruler.ends] == ["0", length_text(ruler.length_m)]
    assert (ruler.marks[:, 1, 2] > ruler.marks[:, 0, 2]).all()


def test_a_view_that_hardly_moves_leaves_it_where_it_is():
    at = np.array([12.0, 1.0, 0.0])
    rulers = {Ruler.before(looking(np.array([-8.0, 0.02 * k, 5]), at), at, -1.7) for k in range(20)}
    assert len(rulers) == 1


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (1e12, 0.0, 0.0), (0.0, 0.0, -1e12)])
def test_odd_views_have_a_finite_bar(at: tuple[float, float, float]):
    eye = looking(np.zeros(3), np.array([1.0, 0, -1]))
    ruler = Ruler.before(eye, np.array(at), 0.0)
    assert np.isfinite(ruler.pieces).all()
    assert ruler.length_m > 0


def road(tilt: float = 0.02) -> PointCloud:
    """A road that rises to the left, 1.6 m below, with walls, seen from the origin."""
    rng = np.random.default_rng(0)
    flat = rng.uniform((2, -8, 0), (40, 8, 0), (20_000, 3))
    flat[:, 2] = -1.6 + tilt * flat[:, 1] + rng.normal(0, 0.02, len(flat))
    wall = rng.uniform((5, 8, -1.6), (40, 8.1, 4), (8000, 3))
    return PointCloud(np.concatenate([flat, wall]).astype(np.float32), "velodyne")


def test_the_ground_is_where_the_road_is():
    assert ground_below_m([road()]) == pytest.approx(-1.6, abs=0.02)
    assert ground_below_m([PointCloud(np.zeros((0, 3), np.float32), "a"), road()]) == pytest.approx(
        -1.6, abs=0.02
    )


def test_without_a_ground_it_is_below_what_there_is():
    assert ground_below_m([]) is None
    few = PointCloud(np.float32([[1, 0, 3], [2, 0, 4]]), "a")
    assert ground_below_m([few]) == pytest.approx(3.0, abs=0.05)


def test_rings_are_round():
    segments = rings(-1.5)
    radii = np.linalg.norm(segments[..., :2], axis=-1)
    assert sorted(set(np.round(radii, 3).ravel().tolist())) == list(RANGES_M)
    assert (segments[..., 2] == -1.5).all()
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).max() < 6
