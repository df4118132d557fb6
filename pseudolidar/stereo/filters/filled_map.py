"""`--fill surfaces`: holes filled where their rim says what is in them, never across an edge."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StereoConfig
from pseudolidar.stereo.filters.map_filter import Filtered, picture8, sigma_or_usual
from pseudolidar.structures.arrays import AnyArray, Float32, UInt8
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Sigma of a filled pixel: of its rim, how far that lies off a plane, and px a pixel from it. A
# shadow takes over what is beside it, so that every pixel away counts more. On KITTI stereo 2015
# 73 % / 96 % of the errors on planes lie within sigma / the 95 % radius, 82 % / 93 % in shadows.
GROWTH_PX = {1: 0.2, 2: 0.4}


@dataclass(frozen=True)
class Surfaces:
    """Fill holes: by a plane where all of the rim lies on one, by the background in shadows.

    A hole that is neither stays one: no filled pixel lies between two surfaces. Holes that are open
    to the top of the picture, or too far away, stay too: the sky is.

    Args:
        largest_px: wider holes stay, along the row.
        largest_m: wider holes stay, at the depth of what would fill them.
        max_depth_m: holes farther than this stay.
    """

    largest_px: int = 40
    largest_m: float = 2.0
    max_depth_m: float = 80.0

    def __post_init__(self) -> None:
        for name in ("largest_px", "largest_m", "max_depth_m"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise StereoConfig(f"{name} = {value:g}", want="a positive number")
        if self.largest_px > np.iinfo(np.int16).max:
            raise StereoConfig(f"largest_px = {self.largest_px}", want="at most 32767")

    def load(self) -> SurfaceFilter:
        """The filter, its kernels compiled or read from the cache."""
        from pseudolidar.stereo.filters import filling_kernels  # noqa: F401  kernels are made on import

        return SurfaceFilter(self)


@dataclass(frozen=True, eq=False)
class Filling:
    """What fills the holes of a map; all (H, W), meant only where `kind` is set.

    Args:
        kind: uint8, 0 none, 1 one surface, 2 shadow of what stands on the right.
        values: float32 px.
        sigma: float32 px.
    """

    kind: UInt8
    values: Float32
    sigma: Float32


@dataclass(frozen=True)
class SurfaceFilter:
    """A loaded `Surfaces`."""

    settings: Surfaces

    def __call__(self, frame: StereoFrame, disparity: DisparityMap) -> Filtered:
        """Fill the holes that can be; matched pixels stay as they are."""
        from pseudolidar.stereo.filters.filling_kernels import OCCLUSION, SURFACE

        filling = self.filling(frame, disparity)
        filled = filling.kind > 0
        values = np.where(filled, filling.values, disparity.values)
        sigma = disparity.sigma
        if sigma is not None:
            sigma = np.where(filled, filling.sigma, sigma)
        counts = {
            "pixels_filled_on_surfaces": int(np.count_nonzero(filling.kind == SURFACE)),
            "pixels_filled_in_shadows": int(np.count_nonzero(filling.kind == OCCLUSION)),
        }
        return Filtered(DisparityMap(values, sigma), counts)

    def filling(self, frame: StereoFrame, disparity: DisparityMap) -> Filling:
        """What fills which hole."""
        from pseudolidar.stereo.filters import filling_kernels as kernels

        s, rig = self.settings, frame.rig
        values = np.ascontiguousarray(disparity.values)
        distances = np.empty((8, *values.shape), np.int16)
        kernels.rim_distances(disparity.valid, s.largest_px, distances)
        kind = np.empty(values.shape, np.uint8)
        found: list[AnyArray] = [np.zeros_like(values) for _ in range(4)]
        kernels.fill(
            values,
            np.ascontiguousarray(sigma_or_usual(disparity)),
            picture8(frame),
            distances,
            s.largest_px,
            s.largest_m,
            rig.fB_px_m / s.max_depth_m,
            rig.baseline_m,
            rig.doffs_px,
            *(found[0], kind, *found[1:]),
        )
        filling, rim_sigma, off_plane, away = found
        growth = np.array([0.0, GROWTH_PX[1], GROWTH_PX[2]], np.float32)[kind] * away
        sigma = np.sqrt(rim_sigma**2 + off_plane**2 + growth**2)
        return Filling(kind, filling, np.asarray(sigma, np.float32))
