"""A stereo pair resampled as another one would see it, whose disparities are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float32, Float64, UInt8
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection

# Smallest disparity (plus doffs) that is not as good as infinite, px; nothing is nearer than this.
LEAST_PX, NEAREST_M = 0.35, 0.5


@dataclass(frozen=True, eq=False)
class Warp:
    """Where a second pair shows what the pixels of a first left image show.

    Args:
        maps: (3, H, W) float32 px: u and v in the second left image, u in the second right one.
    """

    maps: Float32

    @classmethod
    def by(
        cls,
        disparity: Float32,
        rig: StereoRig,
        T_to_from: Float64,
        correction: DisparityCorrection | None = None,
    ) -> Warp:
        """Of one motion.

        Args:
            disparity: (H, W) px of the first pair, as measured; gaps are filled with the background
                beside them.
            rig: of both pairs; its own correction is not used.
            T_to_from: (4, 4) maps points of the first left camera to the second one.
            correction: systematic error of the disparities of both pairs.
        """
        from pseudolidar.geometry.warp_kernels import warp_maps  # loads numba

        maps = np.empty((3, *disparity.shape), np.float32)
        K = rig.left.K
        numbers = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], rig.fB_px_m, rig.doffs_px)
        camera = np.array([*numbers, LEAST_PX, NEAREST_M], np.float32)
        none = np.zeros(DisparityCorrection.TERMS)
        offset = none if correction is None else correction.coefficients
        warp_maps(
            np.ascontiguousarray(disparity, np.float32),
            camera,
            offset.astype(np.float32),
            np.ascontiguousarray(T_to_from[:3], np.float32),
            maps,
        )
        return cls(maps)

    def left(self, picture: UInt8) -> UInt8:
        """(H, W) the second left image as the first one would see it; 0 outside of it."""
        return _resampled(picture, self.maps[0], self.maps[1])

    def right(self, picture: UInt8) -> UInt8:
        """(H, W) the second right image, every pixel where the left one is."""
        return _resampled(picture, self.maps[2], self.maps[1])

    def at(self, uv: Float32) -> Float64:
        """(N, 3) of the maps at (N, 2) uv, between their pixels."""
        import cv2

        if not len(uv):
            return np.zeros((0, 3))
        u, v = uv[:, :1].copy(), uv[:, 1:].copy()
        columns = [cv2.remap(each, u, v, cv2.INTER_LINEAR)[:, 0] for each in self.maps]
        return np.stack(columns, axis=1).astype(np.float64)


def _resampled(picture: UInt8, u: Float32, v: Float32) -> UInt8:
    import cv2

    return np.asarray(cv2.remap(picture, u, v, cv2.INTER_LINEAR), np.uint8)
