"""Where a picture looks like a pattern: normalised correlation over sizes and places."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pseudolidar.obstacles.overlap import box_iou
from pseudolidar.structures.arrays import Bool, Float32, UInt8

# Sizes that are tried differ by this factor, and around the best by its roots.
STEP = 1.1
FINER = (0.5, 0.25)
# Of two places that overlap by more than this, only the better counts.
OVERLAP = 0.3
LEAST_SIDE_PX = 6
# Of one size, so many places at most.
MOST_A_SIZE = 20
# Patterns are looked for in pictures so small that they have this side, and then again near those
# places where the correlation was that much less at most.
COARSE_SIDE_PX, SLACK = 8, 0.3
# Correlations above 1 by more than this are of flat windows, where they mean nothing.
ROUNDING = 1e-3


@dataclass(frozen=True, eq=False)
class Pattern:
    """What is looked for.

    Args:
        pixels: (h, w) or (h, w, 3).
        opaque: (h, w) what of it counts; None for all.
    """

    pixels: UInt8
    opaque: Bool | None = None

    def resized(self, scale: float) -> Pattern:
        """Larger or smaller, whole pixels."""
        import cv2

        height, width = self.pixels.shape[:2]
        size = max(1, round(width * scale)), max(1, round(height * scale))
        if size == (width, height):
            return self
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        pixels = np.asarray(cv2.resize(self.pixels, size, interpolation=how), np.uint8)
        if self.opaque is None:
            return Pattern(pixels)
        opaque = cv2.resize(self.opaque.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
        return Pattern(pixels, opaque.astype(np.bool_))

    def correlation(self, image: UInt8) -> Float32 | None:
        """(H - h + 1, W - w + 1) with each window of an image; None where it does not fit."""
        import cv2

        if any(a < b for a, b in zip(image.shape[:2], self.pixels.shape[:2], strict=True)):
            return None
        if self.opaque is None or self.opaque.all():
            result = cv2.matchTemplate(image, self.pixels, cv2.TM_CCOEFF_NORMED)
        else:
            # The mask needs a channel for each of the picture's.
            mask = self.opaque.astype(np.uint8)
            if self.pixels.ndim == 3:
                mask = np.repeat(mask[:, :, None], self.pixels.shape[2], axis=2)
            result = cv2.matchTemplate(image, self.pixels, cv2.TM_CCOEFF_NORMED, mask=mask)
        result = np.asarray(result, np.float32)
        return np.where(np.isfinite(result) & (result <= 1 + ROUNDING), result, np.float32(-1))


@dataclass(frozen=True)
class Place:
    """Where a pattern fits.

    Args:
        x: column of its left pixels, with parts of a pixel.
        y: row of its upper ones.
        width: px.
        height: px.
        scale: against the pattern.
        score: correlation.
    """

    x: float
    y: float
    width: int
    height: int
    scale: float
    score: float

    @property
    def box_px(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom."""
        return self.x, self.y, self.x + self.width - 1, self.y + self.height - 1


def best_places(
    image: UInt8, pattern: Pattern, *, scales: tuple[float, float], least_score: float, most: int
) -> list[Place]:
    """The places of the best correlation that do not overlap, best first.

    Args:
        image: (H, W) or (H, W, 3), channels as the pattern's.
        pattern: what is looked for.
        scales: smallest and largest factor.
        least_score: less is no match.
        most: so many.
    """
    shrunk: dict[int, UInt8] = {1: image}
    every: list[Place] = []
    for scale in _scales(*scales):
        times = max(1, int(min(pattern.pixels.shape[:2]) * scale / COARSE_SIDE_PX))
        if times not in shrunk:
            shrunk[times] = _shrunk(image, times)
        coarse = least_score - SLACK if times > 1 else least_score
        peaks = _peaks(shrunk[times], pattern, scale / times, coarse)
        if times > 1:
            every += [fine for peak in peaks for fine in _fine(image, pattern, peak, times)]
        else:
            every += peaks
    chosen: list[Place] = []
    for place in sorted(every, key=lambda place: -place.score):
        if place.score < least_score or len(chosen) == most:
            break
        if all(box_iou(place.box_px, other.box_px) <= OVERLAP for other in chosen):
            chosen.append(place)
    return chosen


def refined(image: UInt8, pattern: Pattern, place: Place) -> Place:
    """The best of the sizes between those that were tried, near a place."""
    for share in FINER:
        for factor in (STEP**share, STEP**-share):
            scale = place.scale * factor
            margin = math.ceil(0.5 * STEP * max(place.width, place.height) * (STEP - 1)) + 2
            top, left = max(0, round(place.y) - margin), max(0, round(place.x) - margin)
            bottom = round(place.y) + place.height + margin
            window = image[top:bottom, left : round(place.x) + place.width + margin]
            for found in _peaks(window, pattern, scale, place.score):
                if found.score > place.score:
                    place = replace(found, x=found.x + left, y=found.y + top)
    return place


def _shrunk(image: UInt8, times: int) -> UInt8:
    import cv2

    size = image.shape[1] // times, image.shape[0] // times
    whole = image[: size[1] * times, : size[0] * times]
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)


def _fine(image: UInt8, pattern: Pattern, peak: Place, times: int) -> list[Place]:
    """The best place of the full picture near one of a smaller picture."""
    margin = 2 * times
    left, top = (max(0, round(at * times) - margin) for at in (peak.x, peak.y))
    right, bottom = left + (peak.width + 5) * times, top + (peak.height + 5) * times
    found = list(_peaks(image[top:bottom, left:right], pattern, peak.scale * times, -1.0))
    if not found:
        return []
    best = found[0]
    return [replace(best, x=best.x + left, y=best.y + top)]


def _scales(smallest: float, largest: float) -> list[float]:
    """From the smallest to the largest, 1 among them where it lies between."""
    low = math.ceil(math.log(smallest, STEP) - 1e-9)
    high = math.floor(math.log(largest, STEP) + 1e-9)
    between = [STEP**k for k in range(low, high + 1)]
    return sorted({smallest, largest, *between})


def _peaks(image: UInt8, pattern: Pattern, scale: float, least: float) -> Iterator[Place]:
    """Local maxima of one size that reach the least score, the best ones."""
    import cv2

    resized = pattern.resized(scale)
    height, width = resized.pixels.shape[:2]
    if min(height, width) < LEAST_SIDE_PX:
        return
    scores = resized.correlation(image)
    if scores is None or scores.max() < least:
        return
    around = cv2.dilate(scores, np.ones((2 * (height // 2) + 1, 2 * (width // 2) + 1), np.uint8))
    rows, columns = np.nonzero((scores >= around) & (scores >= least))
    order = np.argsort(-scores[rows, columns], kind="stable")[:MOST_A_SIZE]
    for y, x in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        dx = _summit(scores[y, max(0, x - 1) : x + 2])
        dy = _summit(scores[max(0, y - 1) : y + 2, x])
        yield Place(x + dx, y + dy, width, height, scale, float(scores[y, x]))


def _summit(three: Float32) -> float:
    """Where a parabola through a maximum and its neighbours is highest, from the middle one."""
    if len(three) < 3:
        return 0.0
    before, top, after = (float(value) for value in three)
    bend = before - 2 * top + after
    return 0.0 if bend >= 0 else float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5))
