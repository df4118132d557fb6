"""Which pixels belong to which object: nearest first, each pixel to one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.obstacles.class_sizes import size_of_class
from pseudolidar.obstacles.frustum import Frustum, frustum_of
from pseudolidar.obstacles.modes import depth_modes
from pseudolidar.obstacles.plausible import log_plausible
from pseudolidar.obstacles.riding import ride
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.arrays import Int64, UInt8
from pseudolidar.structures.box import Detection

# Fewer pixels than this tell nothing.
LEAST_PIXELS = 8
# An object may be longer than its class by so much, and its far end is known so badly.
LONGER, END_SIGMAS = 1.15, 2.0
# Where a mode begins: the depth that this share of its pixels is nearer than.
BEGIN = 0.1
# A farther mode is taken for a nearer one only where it is more plausible by this, in logarithms.
CLEARLY = 0.05
# What few pixels of a box show, where nothing of that class could be, is something else: least
# logarithm of share and plausibility. Objects of which a third is seen have -9.
LEAST_SCORE = -11.0
# An object that shares so much of its pixels with a surer one waits for that.
CONTESTED = 0.5
# So far does the depth of a thing run into what is seen beside it: half a matching window. Pixels
# of that border are left out where this share of an object lies outside of it.
BLED_PX, LEAST_CLEAR = 4, 0.25


@dataclass(frozen=True, eq=False)
class Owned:
    """What is the object's in its frustum.

    Args:
        pixels: that show it; may be empty.
        hidden: share of the box that something nearer fills, 0-1.
        log_plausible: how well the depth fits size and footing; 0 is the best.
        before_m: how far the thing stands behind what is nearer in its box; 0 where nothing is.
    """

    pixels: Frustum
    hidden: float
    log_plausible: float
    before_m: float = 0.0


@dataclass(frozen=True)
class _Choice:
    from_m: float
    to_m: float
    begins_m: float
    score: float
    log_plausible: float

    def of(self, frustum: Frustum) -> Frustum:
        """The pixels in this range of depths."""
        return frustum[(frustum.depth_m >= self.from_m) & (frustum.depth_m <= self.to_m)]


def separated(sight: Sight, detections: Sequence[Detection]) -> tuple[Owned, ...]:
    """The pixels of each detection, in their order; each pixel belongs to one.

    Objects are settled from near to far, and what a nearer one owns is no longer looked at: so an
    occluder takes nothing from what it hides but its pixels. But what is mostly hidden would take
    what hides it for itself: it waits for those that own its pixels with more right. Riders and
    what they ride are at one depth: they may have the same pixels.
    """
    frustums = [frustum_of(sight, detection) for detection in detections]
    first = [_choice(sight, d, f) for d, f in zip(detections, frustums, strict=True)]
    taken = np.zeros(sight.depth.values.shape, np.uint8)
    owned: dict[int, Owned] = {}
    for number in _order(frustums, first):
        shared = [owned[other] for other in owned if ride(detections[number], detections[other])]
        free = _free(frustums[number], _without(taken, shared))
        owned[number] = _owned(frustums[number], free, _choice(sight, detections[number], free))
        taken.flat[owned[number].pixels.pixels] = 1
    return tuple(owned[number] for number in range(len(detections)))


def _without(taken: UInt8, shared: Sequence[Owned]) -> UInt8:
    """(H, W) pixels that are taken, but for those of what one rides, or who rides it."""
    if not shared:
        return taken
    others = taken.copy()
    for one in shared:
        others.flat[one.pixels.pixels] = 0
    return others


def _free(frustum: Frustum, taken: UInt8) -> Frustum:
    """Pixels that no other object owns, nor lie beside its own: there depths run into each other.

    Args:
        frustum: of an object.
        taken: (H, W) 1 where a pixel is owned.
    """
    free = frustum[taken.flat[frustum.pixels] == 0]
    if not len(free):
        return free
    import cv2

    rows, columns = np.divmod(free.pixels, taken.shape[1])
    top, left = max(0, int(rows.min()) - BLED_PX), max(0, int(columns.min()) - BLED_PX)
    window = taken[top : int(rows.max()) + BLED_PX + 1, left : int(columns.max()) + BLED_PX + 1]
    beside = cv2.dilate(window, np.ones((2 * BLED_PX + 1, 2 * BLED_PX + 1), np.uint8))
    clear = free[beside[rows - top, columns - left] == 0]
    return clear if len(clear) >= max(LEAST_PIXELS, LEAST_CLEAR * len(free)) else free


def _owned(whole: Frustum, free: Frustum, choice: _Choice | None) -> Owned:
    if choice is None:
        hidden = 1 - len(free) / max(1, len(whole))
        return Owned(free[np.zeros(len(free), bool)], hidden, -np.inf)
    nearer = whole.depth_m < choice.from_m
    hidden = float(whole.weight[nearer].sum()) / whole.area
    before_m = choice.begins_m - float(np.median(whole.depth_m[nearer])) if nearer.any() else 0.0
    return Owned(choice.of(free), hidden, choice.log_plausible, before_m)


def _order(frustums: Sequence[Frustum], first: Sequence[_Choice | None]) -> list[int]:
    """From near to far, but behind those that own most of the same pixels with a better score."""
    chosen = {i: choice for i, choice in enumerate(first) if choice is not None}
    pixels = {i: choice.of(frustums[i]).pixels for i, choice in chosen.items()}
    left = sorted(chosen, key=lambda i: chosen[i].begins_m)
    order: list[int] = []
    while left:
        number = left[0]
        while (better := _contested(number, left, chosen, pixels)) is not None:
            number = better
        left.remove(number)
        order.append(number)
    return order + [i for i, choice in enumerate(first) if choice is None]


def _contested(
    number: int, others: Sequence[int], chosen: dict[int, _Choice], pixels: dict[int, Int64]
) -> int | None:
    for other in others:
        if chosen[other].score > chosen[number].score:
            shared = np.intersect1d(pixels[number], pixels[other], assume_unique=True)
            if len(shared) > CONTESTED * len(pixels[number]):
                return other
    return None


def _choice(sight: Sight, detection: Detection, frustum: Frustum) -> _Choice | None:
    """The range of depths of the object: much in it, and where such a thing may stand."""
    if len(frustum) < LEAST_PIXELS:
        return None
    size = size_of_class(detection.name)
    k = frustum.per_depth_squared
    modes = depth_modes(frustum.depth_m, frustum.weight, k)
    best: _Choice | None = None
    for mode in modes:
        inside = (frustum.depth_m >= mode.from_m) & (frustum.depth_m < mode.to_m)
        begins_m = float(np.quantile(frustum.depth_m[inside], BEGIN))
        to_m = begins_m + LONGER * size.length_m[0] + END_SIGMAS * k * begins_m**2
        held = (frustum.depth_m >= mode.from_m) & (frustum.depth_m <= to_m)
        plausible = log_plausible(sight, detection, begins_m)
        score = float(np.log(frustum.weight[held].sum() / frustum.area)) + plausible
        if best is None or score > best.score + CLEARLY:
            best = _Choice(mode.from_m, to_m, begins_m, score, plausible)
    return None if best is None or best.score < LEAST_SCORE else best
