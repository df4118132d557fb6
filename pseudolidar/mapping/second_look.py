"""Whether two pictures agree with a motion, patch by patch, and the motion they agree with best.

A picture of planar patches tells what the earlier picture must have shown: a wrong motion is seen
at once, however it was found. Direct alignment (Engel et al., Direct Sparse Odometry, 2018) with
windows that are free of gain and offset.
"""

from __future__ import annotations

import cv2
import numpy as np

from pseudolidar.geometry.twists import exp_twist, inverted, log_twist
from pseudolidar.mapping.patches import Patches
from pseudolidar.structures.arrays import Bool, Float32, Float64, UInt8
from pseudolidar.structures.camera import StereoRig

# Windows of 5x5 samples, every so many pixels; compared on pictures of half the size, and found
# first on those of a quarter.
SAMPLES, SPACING_PX = 5, 3.0
LEVEL_FINE, LEVEL_COARSE = 1, 2
# Windows with less contrast than this, grey values, show nothing; so many others are enough.
LEAST_CONTRAST, MOST_WINDOWS, LEAST_WINDOWS = 4.0, 700, 30
# Residuals of normalised windows beyond this, in contrasts, hardly count.
KERNEL = 0.5
MOST_ITERATIONS = 8
STILL_M, STILL_RAD = 5e-4, 5e-5
NEAREST_M = 0.2


class SecondLook:
    """Windows of one picture, to be found in an earlier one.

    Args:
        earlier: (H, W) uint8 grey, left.
        now: of the same size.
        patches: of the later picture.
        rig: rectified.
    """

    def __init__(self, earlier: UInt8, now: UInt8, patches: Patches, rig: StereoRig) -> None:
        self._K = rig.left.K
        self._levels = {
            level: _Level(_halved(earlier, level), level) for level in (LEVEL_FINE, LEVEL_COARSE)
        }
        step = max(1, len(patches) // MOST_WINDOWS)
        self._xyz = _windows(patches[::step], self._K)
        uv = _projected(self._xyz, self._K)
        self._wanted = {}
        seen = np.ones(len(self._xyz), bool)
        for level in self._levels:
            values = _sampled(_halved(now, level), uv, level)
            self._wanted[level], contrast = _normalised(values)
            seen &= contrast > LEAST_CONTRAST
        self._xyz = self._xyz[seen]
        self._wanted = {level: wanted[seen] for level, wanted in self._wanted.items()}

    @property
    def sees(self) -> bool:
        """Whether there is enough to look at."""
        return len(self._xyz) >= LEAST_WINDOWS

    def agreement(self, T_from_to: Float64) -> float:
        """Mean correlation of windows if the camera moved like that, 0-1; 0 for those out of sight.

        Args:
            T_from_to: (4, 4) the later camera's pose in the earlier one.
        """
        there, inside = self._seen_earlier(T_from_to)
        values = self._levels[LEVEL_FINE].grey_at(there)
        got, contrast = _normalised(values)
        correlation = (got * self._wanted[LEVEL_FINE]).mean(axis=1)
        good = inside & (contrast > LEAST_CONTRAST / 2)
        return float(np.where(good, np.maximum(correlation, 0.0), 0.0).mean())

    def best(self, T_from_to: Float64, information: Float64) -> Float64:
        """The motion near `T_from_to` that the pictures agree with best.

        Args:
            T_from_to: (4, 4) where to begin.
            information: (6, 6) how well that is known: a twist on its right.
        """
        T = T_from_to
        for level in (LEVEL_COARSE, LEVEL_FINE):
            for _ in range(MOST_ITERATIONS):
                known, wish = self._equations(T, level)
                wish = wish + information @ log_twist(inverted(T) @ T_from_to)
                step = np.linalg.solve(known + information, wish)
                T = np.asarray(T @ exp_twist(np.asarray(step)))
                if np.linalg.norm(step[:3]) < STILL_M and np.linalg.norm(step[3:]) < STILL_RAD:
                    break
        return T

    def _seen_earlier(self, T: Float64) -> tuple[Float64, Bool]:
        """(N, S, 2) px of all samples in the earlier picture, and which windows lie inside."""
        moved = np.einsum("ij,nsj->nsi", T[:3, :3], self._xyz) + T[:3, 3]
        uv = _projected(moved, self._K)
        height, width = self._levels[LEVEL_FINE].full_size
        inside = (moved[..., 2] > NEAREST_M) & (uv >= 0).all(axis=2)
        inside &= (uv[..., 0] < width - 1) & (uv[..., 1] < height - 1)
        return uv, inside.all(axis=1)

    def _equations(self, T: Float64, level: int) -> tuple[Float64, Float64]:
        """Normal equations of the normalised windows' differences by a twist on the right of T."""
        uv, inside = self._seen_earlier(T)
        picture = self._levels[level]
        got, contrast = _normalised(picture.grey_at(uv))
        residual = got - self._wanted[level]
        weight = 1.0 / (1.0 + (residual / KERNEL) ** 2) ** 2
        weight *= (inside & (contrast > LEAST_CONTRAST / 2))[:, None]
        # d grey / d xi = grad . d uv / d X . R [I, -[p]x]
        gradient = picture.gradient_at(uv) / np.maximum(contrast, 1e-6)[:, None, None]
        X = np.einsum("ij,nsj->nsi", T[:3, :3], self._xyz) + T[:3, 3]
        z = np.maximum(X[..., 2], NEAREST_M)
        gu, gv = gradient[..., 0] * self._K[0, 0] / z, gradient[..., 1] * self._K[1, 1] / z
        by_point = np.stack([gu, gv, -(gu * X[..., 0] + gv * X[..., 1]) / z], axis=-1)
        seen = np.einsum("ji,nsj->nsi", T[:3, :3], by_point)
        J = np.concatenate([seen, np.cross(self._xyz, seen)], axis=-1)
        J -= J.mean(axis=1, keepdims=True)
        J, w, r = J.reshape(-1, 6), weight.reshape(-1), residual.reshape(-1)
        weighted = J * w[:, None]
        scale = 1.0 / KERNEL**2
        return (
            np.einsum("ni,nj->ij", weighted, J) * scale + 1e-6 * np.eye(6),
            -np.einsum("ni,n->i", weighted, r) * scale,
        )


class _Level:
    """An earlier picture at one size, with its slopes."""

    def __init__(self, grey: Float32, level: int) -> None:
        self._grey, self._level = grey, level
        self.full_size = grey.shape[0] << level, grey.shape[1] << level
        self._slopes = tuple(
            np.asarray(cv2.Scharr(grey, cv2.CV_32F, *axes), np.float32) for axes in ((1, 0), (0, 1))
        )

    def grey_at(self, uv: Float64) -> Float64:
        """(N, S) grey values at full-size pixels (N, S, 2)."""
        return _sampled(self._grey, uv, self._level)

    def gradient_at(self, uv: Float64) -> Float64:
        """(N, S, 2) slopes, grey values by full-size pixel."""
        # Scharr's kernel weighs 32.
        scale = 1.0 / (32.0 * 2**self._level)
        return np.stack([scale * _sampled(s, uv, self._level) for s in self._slopes], axis=-1)


def _windows(patches: Patches, K: Float64) -> Float64:
    """(N, S, 3) points of the patches' planes about their centres, one for each sample."""
    offsets = (np.arange(SAMPLES) - SAMPLES // 2) * SPACING_PX
    du, dv = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
    ray = np.empty((len(patches), du.size, 3))
    ray[..., 0] = (patches.xyz[:, 0] / patches.xyz[:, 2])[:, None] + du / K[0, 0]
    ray[..., 1] = (patches.xyz[:, 1] / patches.xyz[:, 2])[:, None] + dv / K[1, 1]
    ray[..., 2] = 1.0
    along = np.einsum("ni,ni->n", patches.normals, patches.xyz)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = along / np.einsum("ni,nsi->ns", patches.normals, ray)
    z = patches.depth_m[:, None]
    sensible = (depth > 0.5 * z) & (depth < 2.0 * z)  # not where the plane is seen edge on
    return ray * np.where(sensible, depth, z)[..., None]


def _projected(xyz: Float64, K: Float64) -> Float64:
    z = np.maximum(xyz[..., 2], NEAREST_M)
    return np.stack(
        [K[0, 0] * xyz[..., 0] / z + K[0, 2], K[1, 1] * xyz[..., 1] / z + K[1, 2]], axis=-1
    )


def _halved(grey: UInt8, level: int) -> Float32:
    small = grey
    for _ in range(level):
        small = np.asarray(cv2.pyrDown(small), np.uint8)
    return small.astype(np.float32)


def _sampled(grey: Float32, uv: Float64, level: int) -> Float64:
    at = (uv / 2**level).astype(np.float32)
    values = cv2.remap(
        grey,
        np.ascontiguousarray(at[..., 0]),
        np.ascontiguousarray(at[..., 1]),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return values.astype(np.float64)


def _normalised(values: Float64) -> tuple[Float64, Float64]:
    """Windows (N, S) without offset and gain, and their contrast (N,), grey values."""
    centred = values - values.mean(axis=1, keepdims=True)
    contrast = np.sqrt((centred**2).mean(axis=1))
    return centred / np.maximum(contrast, 1e-6)[:, None], contrast
