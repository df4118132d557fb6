"""Removes what is no surface: sky, flying pixels, far ghosts, speckle, lens noise, lone points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.errors import StereoConfig, StructureError
from pseudolidar.geometry.grey import grey8_left
from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Reasons by their number in `Cleaned.reason`, less one; names of the figures in a report.
REASONS = ("sky", "near_noise", "flying", "far_ghosts", "speckle", "isolated")
# An error that is tolerated: 0.5 m and 5 % of the depth.
TOLERANCE_M, TOLERANCE_REL = 0.5, 0.05
# Depths to which neighbours hang together: half a pixel of noise, and the slope of a surface.
LINK_PX, LINK_REL = 0.5, 0.02
# Small parts nearer than this are noise of the lens or of the range's end, m; called so, not
# treated otherwise.
NEAR_M = 5.0
# Rows that edges are looked for in together.
STRIP_ROWS = 48
# Sky is no darker than this share of the brightest levels (the 95th percentile) of the upper half.
BRIGHT_SHARE = 0.6
# A smooth bright region with so many cells nearer than this is a wall, not sky.
SKY_NEAR_M, SKY_NEAR_SHARE = 40.0, 0.35
# What fills this share of the picture is no speckle, however small: a hand or a sheet of paper half
# a metre away. At 3 m of KITTI's cameras the smallest area of a surface is 0.6 % of the picture.
# Nearer than this nothing is held before cameras, m.
NO_SPECKLE_SHARE, AT_LENS_M = 0.01, 0.1


@dataclass(frozen=True)
class Clean:
    """Remove what is no surface from a disparity map; each part can be left out.

    Args:
        sky: smooth, bright, cold-coloured regions that hang together with the upper border.
        near_noise: matches outside the right image. Small parts nearer than 5 m count under this
            name; `speckle` removes them.
        flying: pixels between a nearer and a farther surface, and pixels at depth edges whose error
            is too large.
        far_ghosts: pixels whose error is too large anywhere.
        speckle: small surfaces on their own, but for those that fill 1 % of the picture.
        isolated: points with few others around them.
        angle_deg: smallest angle between a surface and the ray to it; steeper steps are edges.
        gap_sigmas: steps of fewer sigmas are none.
        edge_error: largest sigma of a depth at an edge, as a share of 0.5 m + 5 % of it.
        far_error: largest sigma of a depth anywhere, as a share of 0.5 m + 5 % of it.
        speckle_m2: smallest area that a surface on its own has, square metres.
        neighbours: points that a point has around it, within 2 px.
    """

    sky: bool = True
    near_noise: bool = True
    flying: bool = True
    far_ghosts: bool = True
    speckle: bool = True
    isolated: bool = True
    angle_deg: float = 5.0
    gap_sigmas: float = 3.0
    edge_error: float = 0.35
    far_error: float = 2.0
    speckle_m2: float = 0.05
    neighbours: int = 4

    def __post_init__(self) -> None:
        for name in ("gap_sigmas", "edge_error", "far_error", "speckle_m2", "neighbours"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise StereoConfig(f"{name} = {value:g}", want="a positive number", where=name)
        if not 0 < self.angle_deg < 90:
            raise StereoConfig(
                f"angle_deg = {self.angle_deg:g}", want="above 0 and below 90", where="angle_deg"
            )

    def load(self) -> Cleaner:
        """The cleaner, its kernels compiled or read from the cache."""
        return Cleaner.load(self)


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A disparity map without what is no surface.

    Args:
        disparity: what is left.
        reason: (H, W) uint8, 0 for pixels that were kept or had no disparity, else 1 + the place in
            `REASONS` of what removed them.
        counts: pixels that were kept, and by what removed the others: `pixels_kept_by_cleaning`,
            `pixels_removed_sky` and so on, for the report; empty where nothing was to be cleaned.
    """

    disparity: DisparityMap
    reason: UInt8
    counts: Mapping[str, int]


@dataclass(frozen=True)
class Cleaner:
    """Cleans the disparity map of a frame; picklable, callable from several threads.

    Args:
        settings: what is removed; None keeps everything.
    """

    settings: Clean | None

    @classmethod
    def load(cls, settings: Clean | None) -> Self:
        """With the kernels compiled or read from the cache."""
        if settings is not None:
            from pseudolidar.stereo.filters import clean_kernels, sky_kernel  # noqa: F401
        return cls(settings)

    def __call__(self, frame: StereoFrame, disparity: DisparityMap) -> Cleaned:
        """Remove what is no surface.

        Depths are judged as the rig has them, without its disparity correction: it is smooth, and
        nothing here is that sharp. A map without sigma is judged by its geometry alone.

        Args:
            frame: rectified pair; its left image shows the sky.
            disparity: (H, W) px of the left image.

        Raises:
            StructureError: the disparity map has another size than the image.
        """
        from pseudolidar.stereo.filters import clean_kernels as kernels

        shape = disparity.values.shape
        if shape != frame.left.shape[:2]:
            raise StructureError(
                f"disparity of shape {shape}",
                want=f"{frame.left.shape[:2]}, the image's",
                where=frame.id,
            )
        s = self.settings
        if s is None:
            return Cleaned(disparity, np.zeros(shape, np.uint8), {})
        values = disparity.values.copy()
        sigma = np.empty((0, 0), np.float32) if disparity.sigma is None else disparity.sigma.copy()
        reason = np.zeros(shape, np.uint8)
        rig = np.array([frame.rig.left.focal_px, frame.rig.fB_px_m, frame.rig.doffs_px])
        if s.sky:
            _mark_sky(frame, values, reason)
        if s.near_noise:
            kernels.mark_unseen(values, reason)
        if s.flying or s.far_ghosts:
            _mark_edges(values, sigma, rig, s, reason)
        kernels.erase(values, sigma, reason)
        if s.speckle:
            kernels.mark_speckles(
                values,
                reason,
                LINK_PX,
                LINK_REL,
                frame.rig.baseline_m,
                frame.rig.doffs_px,
                s.speckle_m2,
                s.speckle_m2 / (NO_SPECKLE_SHARE * values.size),
                frame.rig.fB_px_m / AT_LENS_M - frame.rig.doffs_px,
                frame.rig.fB_px_m / NEAR_M - frame.rig.doffs_px,
            )
            kernels.erase(values, sigma, reason)
        if s.isolated:
            kernels.mark_isolated(values, sigma, reason, rig, s.gap_sigmas, s.neighbours)
            kernels.erase(values, sigma, reason)
        counts = np.zeros(len(REASONS) + 1, np.int64)
        kernels.count_reasons(values, reason, counts)
        named = {"pixels_kept_by_cleaning": int(counts[0])}
        named |= {
            f"pixels_removed_{name}": int(n) for name, n in zip(REASONS, counts[1:], strict=True)
        }
        left = DisparityMap(values, None if disparity.sigma is None else sigma)
        return Cleaned(left, reason, named)


def _mark_edges(values: Float32, sigma: Float32, rig: Float64, s: Clean, reason: UInt8) -> None:
    import cv2

    from pseudolidar.stereo.filters import clean_kernels as kernels

    reach = kernels.EDGE_REACH
    height, width = values.shape
    size = (2 * reach + 1,) * 2
    square, row = np.ones(size, np.uint8), np.ones((1, kernels.THIN_REACH + 1), np.uint8)
    limits = (
        math.tan(math.radians(s.angle_deg)),
        s.gap_sigmas,
        TOLERANCE_M,
        TOLERANCE_REL,
        s.edge_error,
        s.far_error,
    )
    # Strip by strip: what windows need stays in the processor's cache.
    copies = np.empty((3, STRIP_ROWS + 2 * reach, width), np.float32)
    for top in range(0, height, STRIP_ROWS):
        bottom = min(top + STRIP_ROWS, height)
        first, last = max(top - reach, 0), min(bottom + reach, height)
        low, high, valid = copies[:, : last - first]
        kernels.split(values[first:last], low, high, valid)
        inner = slice(top - first, bottom - first)
        window = (
            cv2.dilate(low, square)[inner],
            cv2.erode(high, square)[inner],
            cv2.blur(valid, size)[inner],
            cv2.erode(high[inner], row, anchor=(kernels.THIN_REACH, 0)),
            cv2.erode(high[inner], row, anchor=(0, 0)),
        )
        kernels.mark_edges(
            values,
            sigma,
            (top, bottom),
            window,
            rig,
            np.array(limits),
            s.flying,
            s.far_ghosts,
            reason,
        )


def _mark_sky(frame: StereoFrame, values: Float32, reason: UInt8) -> None:
    import cv2

    from pseudolidar.stereo.filters import clean_kernels, sky_kernel

    grey = grey8_left(frame.left, frame.right)
    colour = frame.left if frame.left.ndim == 3 else np.zeros((1, 1, 1), np.uint8)
    height, width = values.shape
    cells = height // sky_kernel.CELL_PX, width // sky_kernel.CELL_PX
    region, mean = np.zeros(cells, np.int32), np.zeros(cells, np.uint8)
    bright = BRIGHT_SHARE * np.quantile(grey[: height // 2 : 4, ::4], 0.95)
    count = sky_kernel.flood(grey, colour, int(bright), region, mean)
    total, near = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    near_px = frame.rig.fB_px_m / SKY_NEAR_M - frame.rig.doffs_px
    sky_kernel.census_of_regions(values, region, near_px, total, near)
    is_sky = near <= SKY_NEAR_SHARE * total
    is_sky[0] = False
    reach = (2 * sky_kernel.RIM_CELLS + 1,) * 2
    rim = cv2.dilate(is_sky[np.maximum(region, 0)].astype(np.uint8), np.ones(reach, np.uint8)) > 0
    sky_kernel.mark_sky(values, grey, region, mean, is_sky, rim, clean_kernels.SKY, reason)
