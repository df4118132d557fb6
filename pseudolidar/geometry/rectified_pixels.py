"""The pixels of a rectified pair: where each comes from, and which come from nowhere."""

from __future__ import annotations

import functools
import threading
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from pseudolidar.geometry.lens import Lens
from pseudolidar.geometry.rectification import Rectification
from pseudolidar.structures.arrays import Bool, Float32, Float64, Image
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import PairMask

# Rows of a map that are computed at once: memory of a few megabytes, whatever the picture.
ROWS_AT_ONCE = 64
# Where pixels come from that show nothing: outside, for every way to interpolate.
NOWHERE_PX = -16.0
# Pixels this near to one that shows nothing are not matched: what a matcher looks at around them
# (census: 9x7, blocks of 7x7) is not the scene's.
MARGIN_PX = (9, 7)


@dataclass(frozen=True, eq=False)
class EyeMap:
    """Where the pixels of one rectified picture come from.

    Args:
        uv: (H, W, 2) float32 px in the picture as it was taken.
        seen: (H, W) those that come from inside of it.
    """

    uv: Float32
    seen: Bool


def eye_map(camera: Camera, R: Float64, rectified: Camera) -> EyeMap:
    """Where the pixels of a rectified picture come from.

    Args:
        camera: the camera as it is.
        R: (3, 3) turns directions in its frame into the rectified one's.
        rectified: the rectified camera.
    """
    lens, K = Lens.of(camera), rectified.K
    width, height = rectified.size_px
    uv = np.full((height, width, 2), NOWHERE_PX, np.float32)
    seen = np.zeros((height, width), np.bool_)
    x = (np.arange(width) - K[0, 2]) / K[0, 0]
    for first in range(0, height, ROWS_AT_ONCE):
        rows = slice(first, min(first + ROWS_AT_ONCE, height))
        y = (np.arange(rows.start, rows.stop)[:, None] - K[1, 2]) / K[1, 1]
        # Written out: a matrix product may round by the number of threads.
        directions = np.stack(
            [R[0, axis] * x + R[1, axis] * y + R[2, axis] for axis in range(3)], axis=-1
        )
        pixels, holds = lens.pixels(directions)
        seen[rows] = holds & lens.inside(pixels)
        uv[rows] = np.where(seen[rows][..., None], pixels, NOWHERE_PX)
    return EyeMap(uv, seen)


@dataclass(frozen=True, eq=False)
class PairMaps:
    """What rectifies pairs of one rig, in OpenCV's fixed-point form (1/32 px).

    Args:
        left: places and fractions of the left picture.
        right: of the right one.
        mask: pixels of both that show something, less a margin; None where all do.
    """

    left: tuple[Image, Image]
    right: tuple[Image, Image]
    mask: PairMask | None

    @classmethod
    def of(cls, planned: Rectification) -> PairMaps:
        """The maps of a rectification; computed once while the process lasts."""
        with _lock:  # threads that start together would all compute them
            return _maps(_Key(planned))

    def apply(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Rectify two pictures; linear between pixels, black where nothing was seen.

        Args:
            left: (H, W) or (H, W, 3), uint8 or uint16, of the size of the left camera.
            right: of that of the right one.
        """
        return _remapped(left, self.left), _remapped(right, self.right)


def _remapped(image: Image, places: tuple[Image, Image]) -> Image:
    import cv2

    # Cubic costs twice the time and makes disparities no better (0.083 against 0.082 px median
    # error on a rendered room, 2026-11-26).
    how, border = cv2.INTER_LINEAR, cv2.BORDER_CONSTANT
    return cast("Image", cv2.remap(image, *places, how, borderMode=border))


def matched_pixels(left: Bool, right: Bool) -> PairMask | None:
    """The mask of a pair by what its pictures show: less a margin; None where all pixels do.

    Args:
        left: (H, W) pixels of the left picture that show something.
        right: (H, W) of the right one.
    """
    import cv2

    if left.all() and right.all():
        return None
    around = np.ones(MARGIN_PX[::-1], np.uint8)
    kept = (cv2.erode(seen.astype(np.uint8), around).astype(np.bool_) for seen in (left, right))
    return PairMask(*kept)


def unmasked(disparity: DisparityMap, mask: PairMask | None) -> DisparityMap:
    """The disparities whose pixel in the left and match in the right picture show something."""
    if mask is None:
        return disparity
    from pseudolidar.geometry.mask_kernels import drop_unshown

    values = disparity.values.copy()
    sigma = None if disparity.sigma is None else disparity.sigma.copy()
    none = np.empty((0, 0), np.float32)
    left, right = (np.ascontiguousarray(shown) for shown in (mask.left, mask.right))
    drop_unshown(values, none if sigma is None else sigma, left, right)
    return replace(disparity, values=values, sigma=sigma)


@dataclass(frozen=True, eq=False)
class _Key:
    """A rectification by its numbers: equal ones have the same maps."""

    planned: Rectification

    @property
    def numbers(self) -> tuple[object, ...]:
        raw, rig = self.planned.raw, self.planned.rig
        arrays = (self.planned.R_left, self.planned.R_right, rig.left.K)
        eyes = ((eye.K.tobytes(), eye.distortion.tobytes(), eye.model, eye.size_px)
                for eye in (raw.left, raw.right))  # fmt: skip
        shown = (rig.left.size_px, self.planned.shown_rows)
        return (*eyes, *(array.tobytes() for array in arrays), *shown)

    def __hash__(self) -> int:
        return hash(self.numbers)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.numbers == other.numbers


# Maps of so many rigs or views are kept: computing them takes as long as many frames.
MAPS_KEPT = 8
_lock = threading.Lock()


@functools.lru_cache(MAPS_KEPT)
def _maps(key: _Key) -> PairMaps:
    planned = key.planned
    eyes = (
        eye_map(planned.raw.left, planned.R_left, planned.rig.left),
        eye_map(planned.raw.right, planned.R_right, planned.rig.right),
    )
    left, right = (_fixed_point(eye) for eye in eyes)
    mask = matched_pixels(eyes[0].seen, eyes[1].seen)
    return PairMaps(left, right, _only_rows(mask, planned))


def _only_rows(mask: PairMask | None, planned: Rectification) -> PairMask | None:
    """The mask without rows that a neighbouring view shows."""
    if planned.shown_rows is None:
        return mask
    width, height = planned.rig.left.size_px
    everywhere = np.ones((height, width), np.bool_)
    mask = mask or PairMask(everywhere, everywhere)
    rows = np.arange(height)[:, None]
    shown = (rows >= planned.shown_rows[0]) & (rows < planned.shown_rows[1])
    return PairMask(mask.left & shown, mask.right & shown)


def _fixed_point(eye: EyeMap) -> tuple[Image, Image]:
    """Whole pixels (int16) and 32nds of them, which OpenCV remaps twice as fast by."""
    import cv2

    u, v = (np.ascontiguousarray(eye.uv[..., axis]) for axis in range(2))
    return cast("tuple[Image, Image]", cv2.convertMaps(u, v, cv2.CV_16SC2))
