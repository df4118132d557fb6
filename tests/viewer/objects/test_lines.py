"""Boxes as lines."""

from __future__ import annotations

import numpy as np

from pseudolidar.structures.box import Box3D
from pseudolidar.structures.pose import Pose
from pseudolidar.viewer.objects.drawn import apart
from pseudolidar.viewer.objects.lines import DASHES, coloured, dashed, edges_of
from pseudolidar.viewer.objects.scene import ShownWords

BOX = Box3D(Pose("a", "b", np.eye(4)), 4.0, 2.0, 1.0)


def test_edges_are_as_long_as_the_box():
    edges = edges_of([BOX.corners_m(), BOX.corners_m()])
    assert edges.shape == (24, 2, 3)
    lengths = np.linalg.norm(edges[:12, 1] - edges[:12, 0], axis=1)
    assert sorted(lengths) == [1] * 4 + [2] * 4 + [4] * 4
    assert edges_of([]).shape == (0, 2, 3)


def test_dashes_begin_and_end_with_their_edge():
    edges = edges_of([BOX.corners_m()])
    dashes = dashed(edges).reshape(12, DASHES, 2, 3)
    assert np.allclose(dashes[:, 0, 0], edges[:, 0])
    assert np.allclose(dashes[:, -1, 1], edges[:, 1])
    drawn = np.linalg.norm(dashes[:, :, 1] - dashes[:, :, 0], axis=2).sum(axis=1)
    whole = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert np.allclose(drawn / whole, DASHES / (2 * DASHES - 1))


def test_colours_are_of_their_lines():
    colours = coloured([(255, 0, 0), (0, 255, 0)], 3)
    assert colours.shape == (6, 2, 3)
    assert np.all(colours[:3] == (255, 0, 0))
    assert np.all(colours[3:] == (0, 255, 0))
    assert np.all(coloured([(128, 64, 0)], 1) == (56, 12, 0))  # light, not what a screen is sent


def test_words_that_would_cover_nearer_ones_are_left_out():
    def at(text: str, x: float, y: float) -> ShownWords:
        return ShownWords(text, BOX.corners_m() + np.array([x, y, 0]), (0, 0, 0))

    kept = apart([at("near", 8, 0), at("beside", 8, 6), at("behind", 9, 0.2)])
    assert [words.text for words in kept] == ["near", "beside"]
