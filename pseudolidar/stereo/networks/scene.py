"""A synthetic textured pair of exactly known disparity, to find out what a network does.

Surfaces whose disparity is constant along each row, so that the right view is an exact shift of
each: a slanted ground and several nearer patches. Their edges tell the left view's disparities from
the right view's, and so swapped inputs from a swapped sign. Blue is the noisiest colour, as in
cameras: networks trained on photographs trust it least, which tells RGB from BGR.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import AnyArray, Bool, Float32, UInt8

# Disparities as shares of the width: inside the range of every network that is published, and
# 4 px or more at the smallest published size, 160 x 120.
_NEAREST_SHARE, _FARTHEST_SHARE = 0.08, 0.025
_PATCHES = 7
_NOISE_LEVELS = np.array([3.0, 3.0, 16.0])  # of R, G, B, in 8-bit levels


@dataclass(frozen=True, eq=False)
class ProbeScene:
    """A pair with its truth.

    Args:
        left: (H, W, 3) RGB.
        right: like left.
        truth: (H, W) float32 px, of the left image.
        visible: (H, W) pixels that the right image sees too.
    """

    left: UInt8
    right: UInt8
    truth: Float32
    visible: Bool


@functools.lru_cache(maxsize=2)  # the same one is shown in every way of feeding
def probe_scene(width: int, height: int, *, seed: int, gain: float = 1.0) -> ProbeScene:
    """The scene of a seed.

    Args:
        width: px.
        height: px.
        seed: of texture and patches.
        gain: brightness, 0-1.
    """
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    far, near = _FARTHEST_SHARE * width, _NEAREST_SHARE * width
    ground = far + (0.4 * (near - far) / height) * y
    layers = [(ground, np.full((height, width), True))]
    for nearness in np.linspace(0.45, 1.0, _PATCHES):
        w, h = rng.uniform(0.12, 0.3) * width, rng.uniform(0.2, 0.45) * height
        x0, y0 = rng.uniform(0.1, 0.95) * width - w / 2, rng.uniform(0, 1) * height - h / 2
        inside = (abs(x - x0 - w / 2) < w / 2) & (abs(y - y0 - h / 2) < h / 2)
        layers.append((np.full_like(x, far + nearness * (near - far)), inside))
    left, right = np.empty((height, width, 3)), np.empty((height, width, 3))
    truth, owner = np.empty((height, width), np.float32), np.zeros((height, width), np.int32)
    right_owner = np.full((height, width), -1)
    for index, (shift, inside) in enumerate(layers):
        texture = _texture(rng, height, width + int(near) + 4)
        there = x + shift  # of a right pixel, in the left image
        seen = np.take_along_axis(inside, np.clip(np.rint(there), 0, width - 1).astype(int), 1)
        seen &= (there <= width - 1) | (index == 0)
        left[inside] = texture[:, :width][inside]
        truth[inside], owner[inside] = shift[inside], index
        right[seen] = _sampled(texture, there)[seen]
        right_owner[seen] = index
    target = np.rint(x - truth).astype(int)
    met = np.take_along_axis(right_owner, np.clip(target, 0, width - 1), 1)
    visible = (target >= 0) & (met == owner)
    return ProbeScene(
        _photographed(left * gain, rng), _photographed(right * gain, rng), truth, visible
    )


def _texture(rng: np.random.Generator, height: int, width: int) -> Float32:
    """(H, W, 3): structure of many sizes, mostly grey, with some colour."""
    import cv2

    total = np.zeros((height, width, 3), np.float32)
    for blur_px in (1.0, 2.5, 6.0):
        noise = rng.standard_normal((height, width, 1)) + 0.4 * rng.standard_normal(
            (height, width, 3)
        )
        smooth = cv2.GaussianBlur(noise.astype(np.float32), (0, 0), blur_px)
        total += smooth / smooth.std()
    return np.asarray(np.clip(128 + rng.uniform(-75, 75) + 22 * total, 4, 251), np.float32)


def _sampled(texture: Float32, x: Float32) -> Float32:
    import cv2

    rows = np.arange(len(x), dtype=np.float32)[:, None] + 0 * x
    return np.asarray(cv2.remap(texture, x, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def _photographed(image: AnyArray, rng: np.random.Generator) -> UInt8:
    noisy = image + _NOISE_LEVELS * rng.standard_normal(image.shape)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)
