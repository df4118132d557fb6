"""Evidence without truth: it speaks for exact disparities, and against each kind of mistake."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pseudolidar.evaluation.blind import (
    BINS,
    LEFT_RIGHT,
    PairEvidence,
    evidence_shares,
    judged_by_pair,
)
from pseudolidar.sources.synthetic import Synthetic


@pytest.fixture(scope="module")
def scene():
    """A pair with the pair after it, and exact disparities of both eyes and of the next frame."""
    source = Synthetic("room", frames=6, seed=4, width_px=320).open()
    frame, following = source.load(2), source.load(3)
    exact = source.truth_pair(2)
    left = np.where(exact.occluded, np.nan, exact.left.values).astype(np.float32)
    pair = PairEvidence.of(frame, following)
    assert pair.follows
    return frame, pair, left, exact.right.values, following.truth.values


def shares(scene, values=None, right=None, then=None):
    frame, pair, left, of_right, following = scene
    found = evidence_shares(
        pair,
        left if values is None else values,
        of_right if right is None else right,
        following if then is None else then,
        np.ones(len(frame.left), bool),
    )
    return np.split(found, np.cumsum(BINS)[:-1])


def loss(scene, values=None, right=None, then=None):
    frame, pair, left, of_right, following = scene
    return judged_by_pair(
        pair,
        left if values is None else values,
        of_right if right is None else right,
        following if then is None else then,
        np.ones(len(frame.left), bool),
    ).loss


def test_exact_disparities_agree_with_everything(scene):
    left_right, photometric, _, temporal, _ = shares(scene)
    matched = left_right.sum()
    assert all(kind.sum() == pytest.approx(matched) for kind in shares(scene))
    assert left_right[: len(LEFT_RIGHT) - 1].sum() > 0.93 * matched
    assert photometric[:3].sum() > 0.8 * matched
    assert temporal[:2].sum() > 0.8 * matched


def test_noise_and_outliers_cost(scene):
    left, right, then = scene[2], scene[3], scene[4]
    rng = np.random.default_rng(0)

    def worse(values, share):
        wrong = rng.random(values.shape) < share
        blocks = cv2.dilate(wrong.astype(np.uint8), np.ones((5, 5))) > 0
        return np.where(blocks, values + rng.uniform(5, 15), values).astype(np.float32)

    losses = [loss(scene)]
    for share in (0.002, 0.01, 0.03):
        losses.append(loss(scene, worse(left, share), worse(right, share), worse(then, share)))
    assert losses == sorted(losses)
    assert losses[-1] > losses[0] + 0.05


def test_gaps_cost_less_than_outliers_and_more_than_what_is_right(scene):
    left = scene[2]
    inner = np.zeros(left.shape, bool)
    inner[80:160, 150:250] = True
    gap = np.where(inner, np.nan, left).astype(np.float32)
    wrong = np.where(inner, left + 12, left).astype(np.float32)
    assert loss(scene) < loss(scene, gap) < loss(scene, wrong)


def test_surfaces_that_have_grown_over_their_edges_are_seen(scene):
    left, right, then = scene[2], scene[3], scene[4]
    square = np.ones((9, 9), np.uint8)
    fat = [cv2.dilate(np.nan_to_num(each), square) for each in (left, right, then)]
    fat[0][~np.isfinite(left)] = np.nan
    assert shares(scene, *fat)[4][-1] > 2 * shares(scene)[4][-1]


def test_a_next_frame_that_shows_something_else_tells_nothing(scene):
    frame = scene[0]
    other = Synthetic("street", frames=1, width_px=320, height_px=240).open().load(0)
    assert not PairEvidence.of(frame, other).follows
    assert not PairEvidence.of(frame).follows
    smaller = Synthetic("room", frames=1, width_px=160).open().load(0)
    assert not PairEvidence.of(frame, smaller).follows
    grey = replace(frame, left=frame.left[:, :, 1], right=frame.right[:, :, 1])
    assert PairEvidence.of(grey, grey).follows


def test_a_map_without_a_disparity_costs_what_its_gaps_do(scene):
    empty = np.full_like(scene[2], np.nan)
    judged = judged_by_pair(scene[1], empty, empty, None, np.ones(len(empty), bool))
    assert judged.density == 0.0
    assert judged.loss > loss(scene)
