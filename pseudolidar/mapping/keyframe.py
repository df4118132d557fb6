"""A frame that others are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.geometry.tracking import CORNERS_PRECISE, MatchedPair, Seeds
from pseudolidar.structures.arrays import AnyArray, Bool
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig


@dataclass(frozen=True, eq=False)
class Sight:
    """What one frame shows.

    Args:
        number: of the frame, counted from the first one that was registered.
        pair: its pictures and disparities.
        movable: (H, W) pixels of things that may move by themselves, or None.
    """

    number: int
    pair: MatchedPair
    movable: Bool | None = None

    @property
    def blind(self) -> str:
        """Why nothing can be told from it at all, or nothing."""
        if not np.isfinite(self.pair.disparity).any():
            return "no pixel has a disparity: black, covered, or without texture"
        if np.array_equal(self.pair.left, self.pair.right):
            return "left and right are the same picture"
        return ""

    def frozen_since(self, before: Sight) -> str:
        """Whether its picture came before, in words: no camera is without noise."""
        if np.array_equal(self.pair.left, before.pair.left):
            return "the same picture as the frame before, to the last bit: the camera is frozen"
        return ""

    def still(self, uv: AnyArray) -> Bool:
        """(N,) which points (N, 2) px are not on things that may move."""
        if self.movable is None:
            return np.ones(len(uv), np.bool_)
        height, width = self.movable.shape
        column, row = np.rint(uv).astype(np.intp).T
        near = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        return np.asarray(~self.movable[near])


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A frame that others are compared with.

    Args:
        sight: what it shows.
        seeds: corners that both of its eyes see, none of them on things that may move.
    """

    sight: Sight
    seeds: Seeds

    @classmethod
    def of(cls, sight: Sight, rig: StereoRig) -> Keyframe:
        """Find its corners."""
        seeds = Seeds.of(sight.pair, rig, CORNERS_PRECISE)
        return cls(sight, seeds[sight.still(seeds.uv)])


def movable_pixels(movable: Sequence[Detection], shape: tuple[int, int]) -> Bool | None:
    """(H, W) pixels of objects: of their masks, or of their boxes where they have none."""
    if not movable:
        return None
    covered = np.zeros(shape, np.bool_)
    for one in movable:
        if one.mask is not None:
            covered |= one.mask
            continue
        left, top, right, bottom = one.box_px
        rows = slice(max(0, int(np.floor(top))), max(0, int(np.ceil(bottom)) + 1))
        covered[rows, max(0, int(np.floor(left))) : max(0, int(np.ceil(right)) + 1)] = True
    return covered
