"""Reference points of many frames as columns, with what stereo says at each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pseudolidar.evaluation.compared import ComparedFrame
from pseudolidar.structures.arrays import Bool, Float64, Int64


@dataclass(frozen=True, eq=False)
class ComparedPoints:
    """Reference points that the left camera sees; NaN where stereo has no point.

    Args:
        frames: number of frames.
        frame: (N,) number of the frame, from 0.
        reference_m: (N,) true depth Z, m.
        depth_m: (N,) depth Z of stereo.
        reference_px: (N,) disparity that the reference calls for.
        error_px: (N,) disparity of stereo, corrected as the rig says, minus that.
        column: (N,) where in the image, 0 at its left and 1 at its right border.
        sigma_px: (N,) total sigma of the disparity; None where a frame has none.
    """

    frames: int
    frame: Int64
    reference_m: Float64
    depth_m: Float64
    reference_px: Float64
    error_px: Float64
    column: Float64
    sigma_px: Float64 | None = None

    @classmethod
    def of(cls, frames: Sequence[ComparedFrame]) -> ComparedPoints:
        """All points of the frames; those that stereo has beyond infinity count as none."""
        depths = [frame.depth_m for frame in frames]
        errors = [frame.corrected_px - frame.reference_px for frame in frames]
        sigmas = [s for frame in frames if (s := frame.total_sigma_px) is not None]
        depth_m, error_px = joined(depths), joined(errors)
        return cls(
            frames=len(frames),
            frame=np.repeat(np.arange(len(frames)), [len(frame) for frame in frames]),
            reference_m=joined([frame.reference_m for frame in frames]),
            depth_m=depth_m,
            reference_px=joined([frame.reference_px for frame in frames]),
            error_px=np.where(np.isfinite(depth_m), error_px, np.nan),
            column=joined([frame.u / (frame.rig.left.width_px - 1) for frame in frames]),
            sigma_px=joined(sigmas) if frames and len(sigmas) == len(frames) else None,
        )

    def __len__(self) -> int:
        return len(self.reference_m)

    def __getitem__(self, chosen: Bool | slice) -> ComparedPoints:
        """The chosen points; the number of frames stays."""
        return ComparedPoints(
            frames=self.frames,
            frame=self.frame[chosen],
            reference_m=self.reference_m[chosen],
            depth_m=self.depth_m[chosen],
            reference_px=self.reference_px[chosen],
            error_px=self.error_px[chosen],
            column=self.column[chosen],
            sigma_px=None if self.sigma_px is None else self.sigma_px[chosen],
        )

    @property
    def matched(self) -> Bool:
        """(N,) reference points that stereo has a point for."""
        return np.isfinite(self.depth_m)


def joined(parts: Sequence[Float64]) -> Float64:
    """The arrays one after the other, empty without any."""
    return np.concatenate(parts) if parts else np.empty(0)
