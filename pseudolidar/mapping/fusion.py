"""Disparities of a frame made one with those of the frames before it, along a known path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StereoConfig
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.twists import inverted
from pseudolidar.structures.arrays import AnyArray, Bool, Float32, Float64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DisparityMap

# Carrying a disparity to the next frame makes it less sure by a variance, px^2: that of its place
# in the picture and of the step. Measured on KITTI odometry 06, 2026-11.
DRIFT_PX2 = 0.02
# What is added to the variances of two disparities that are to be one, px^2.
MARGIN_PX2 = 0.1
# Share of a measurement's variance that no number of frames averages away.
COMMON_SHARE = 0.05
# Surfaces steeper than this are carried pixel by pixel, px a px.
STEEPEST = 1.0
# Sigma of disparities that come without one, px.
USUAL_SIGMA_PX = 0.3
# Nothing nearer is carried, m.
NEAREST_M = 0.3


@dataclass(frozen=True, eq=False)
class FusedFrame:
    """A frame's disparities with those of the frames before.

    Args:
        inverse_depth: (H, W) float32 f B / Z, px, of the rig without its correction; NaN where
            nothing was measured in this frame.
        variance: (H, W) float32 of that, px^2.
        counts: (H, W) uint16 frames that agree, this one included; 0 where there is none.
        rig: of the frame.
    """

    inverse_depth: Float32
    variance: Float32
    counts: AnyArray
    rig: StereoRig

    @property
    def depth_m(self) -> Float32:
        """(H, W) Z."""
        return np.asarray(np.float32(self.rig.fB_px_m) / self.inverse_depth, np.float32)

    @property
    def sigma_m(self) -> Float32:
        """(H, W) one standard deviation of Z, without what the rig leaves in all frames alike."""
        depth = self.depth_m
        fB = np.float32(self.rig.fB_px_m)
        return np.asarray(depth**2 / fB * np.sqrt(self.variance), np.float32)


@dataclass(frozen=True)
class TemporalFusion:
    """Each frame's disparities are joined with what the frames before say of the same surface.

    What moves, or comes into view, begins anew: it does not agree with what was there.

    Args:
        gate: largest disagreement, in its standard deviations.
    """

    gate: float = 2.5

    def __post_init__(self) -> None:
        if not 0 < self.gate < 100:
            raise StereoConfig(f"gate = {self.gate:g}", want="above 0, such as 2.5")

    def start(self) -> Fusion:
        """Begin with the first frame to come."""
        return Fusion(self)


class Fusion:
    """Goes along frames in order of time.

    Args:
        settings: as declared.
    """

    def __init__(self, settings: TemporalFusion) -> None:
        drift = (DRIFT_PX2, settings.gate, MARGIN_PX2, COMMON_SHARE, STEEPEST)
        self._limits = np.array(drift, np.float32)
        self._last: tuple[Float32, AnyArray, Float64] | None = None

    def add(
        self,
        disparity: DisparityMap,
        rig: StereoRig,
        T_map_camera: Float64,
        *,
        movable: Bool | None = None,
    ) -> FusedFrame:
        """Join a frame's disparities with what is known.

        Args:
            disparity: of the left image, as measured.
            rig: with the correction that is to be taken off.
            T_map_camera: (4, 4) where the left camera was.
            movable: (H, W) pixels of things that may move by themselves: they are forgotten.
        """
        from pseudolidar.mapping.fusion_kernels import carry, join

        measured = _measured(disparity, rig, movable)
        shape = disparity.values.shape
        if self._last is None:
            counts = (measured[0] > 0).astype(np.uint16)
            fused = measured
        else:
            before, seen_before, T_map_before = self._last
            T = np.ascontiguousarray((inverted(T_map_camera) @ T_map_before)[:3], np.float32)
            carried = np.empty((4, *shape), np.float32)
            seen, counts = np.zeros(shape, np.uint16), np.empty(shape, np.uint16)
            fused = np.empty((2, *shape), np.float32)
            carry(before, seen_before, camera_numbers(rig), T, carried, seen)
            join(carried, seen, measured, self._limits, fused, counts)
        self._last = fused, counts, T_map_camera
        return FusedFrame(fused[0], fused[1], counts, rig)


def camera_numbers(rig: StereoRig) -> Float32:
    """(6,) what kernels know of the left camera: fx, fy, cx, cy px, f B px m, nearest depth m."""
    K = rig.left.K
    numbers = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], rig.fB_px_m, NEAREST_M)
    return np.array(numbers, np.float32)


def _measured(disparity: DisparityMap, rig: StereoRig, movable: Bool | None) -> Float32:
    """(2, H, W) f B / Z and its variance."""
    depth = depth_map(disparity, rig).values
    measured = np.empty((2, *depth.shape), np.float32)
    np.divide(np.float32(rig.fB_px_m), depth, out=measured[0])
    sigma = disparity.sigma
    measured[1] = USUAL_SIGMA_PX**2 if sigma is None else np.square(sigma)
    if movable is not None:
        measured[0][movable] = np.nan
    return measured
