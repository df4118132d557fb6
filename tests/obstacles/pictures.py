"""Sights of painted pictures: grey, colour, 8 and 16 bits, with a right eye."""

from __future__ import annotations

import dataclasses

import numpy as np

from pseudolidar.obstacles.sight import Sight
from tests.obstacles.scene import HEIGHT, WIDTH, sight

GREY = np.array([110, 120, 105])


def textured(seed: int = 0) -> np.ndarray:
    """(H, W, 3) smooth colourless noise."""
    import cv2

    noise = np.random.default_rng(seed).uniform(0, 90, (HEIGHT, WIDTH)).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return (GREY - 40 + (noise - noise.mean())[:, :, None] * 3).clip(0, 255).astype(np.uint8)


def painted(image: np.ndarray, box: tuple[float, float, float, float], colour) -> np.ndarray:
    """The image with a rectangle whose edges lie between pixels: rims are mixed."""
    left, top, right, bottom = box
    u, v = np.arange(image.shape[1]), np.arange(image.shape[0])
    across = np.clip(np.minimum(u + 0.5, right) - np.maximum(u - 0.5, left), 0, 1)
    down = np.clip(np.minimum(v + 0.5, bottom) - np.maximum(v - 0.5, top), 0, 1)
    share = (down[:, None] * across)[:, :, None]
    return np.round(image * (1 - share) + np.asarray(colour) * share).astype(np.uint8)


def seen(image: np.ndarray, right: np.ndarray | None = None, things=()) -> Sight:
    """A sight with those pictures."""
    return dataclasses.replace(sight(things), image=image, right=right)


def blind(one: Sight) -> Sight:
    """The same without any depth."""
    depth = dataclasses.replace(
        one.depth, values=np.full_like(one.depth.values, np.nan), sigma=None
    )
    return dataclasses.replace(one, depth=depth, ground=None, is_ground=None)
