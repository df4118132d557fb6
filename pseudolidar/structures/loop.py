"""Loops: returns to places that were seen before, and the path that they close."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.errors import StructureError
from pseudolidar.structures.arrays import Float32, Float64, check_array
from pseudolidar.structures.pose import Trajectory


@dataclass(frozen=True, eq=False)
class LoopEnd:
    """One of the two frames that a loop joins.

    Args:
        index: of the frame in its source.
        timestamp_ns: of the frame, by which poses are found.
        piece: of the path.
    """

    index: int
    timestamp_ns: int
    piece: int = 0


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """A verified return to a known place, with what it rests on.

    Args:
        earlier: frame that saw the place first.
        later: frame that saw it again.
        T_earlier_later: (4, 4) float64 pose of the later left camera in the earlier one, metres.
        covariance: (6, 6) float64 of a twist on its right, order as in `CameraStep`.
        uv_earlier: (N, 2) float32 px, points of the earlier left picture that agree.
        uv_later: (N, 2) float32 px, the same points in the later one.
        residuals_px: (N,) float64 px, how far each point lies in the later picture from where the
            pose puts it.
        matches: descriptors that were alike, of which the N points agree.
        overlap: share, 0-1, of what both frames could see whose depths agree.
        both_ways_m: distance of the poses found from either side.
        both_ways_deg: angle between them.
        correction_m: how far the path as odometry had it disagrees; NaN between pieces.
        correction_deg: angle of that.
    """

    earlier: LoopEnd
    later: LoopEnd
    T_earlier_later: Float64
    covariance: Float64
    uv_earlier: Float32
    uv_later: Float32
    residuals_px: Float64
    matches: int
    overlap: float
    both_ways_m: float
    both_ways_deg: float
    correction_m: float
    correction_deg: float

    def __post_init__(self) -> None:
        check_array("LoopClosure", "T_earlier_later", self.T_earlier_later, (4, 4), np.float64)
        check_array("LoopClosure", "covariance", self.covariance, (6, 6), np.float64)
        check_array("LoopClosure", "residuals_px", self.residuals_px, (None,), np.float64)
        shape = (self.inliers, 2)
        check_array("LoopClosure", "uv_earlier", self.uv_earlier, shape, np.float32)
        check_array("LoopClosure", "uv_later", self.uv_later, shape, np.float32)
        if self.earlier.timestamp_ns >= self.later.timestamp_ns:
            raise StructureError(
                f"frames {self.earlier.index} and {self.later.index}",
                want="the earlier frame first",
                where="LoopClosure",
            )

    @property
    def inliers(self) -> int:
        """How many points agree."""
        return len(self.residuals_px)

    @property
    def residual_px(self) -> float:
        """Median distance of a point from where the pose puts it."""
        return float(np.median(self.residuals_px))


@dataclass(frozen=True, eq=False)
class ClosedPath:
    """Poses of all frames with the loops closed.

    Args:
        trajectories: of each piece, `T_map_camera`.
        maps: for each piece the number of the map that its poses are in: pieces that loops join
            share one, others have nothing in common.
        used: loops that the path keeps.
        dropped: loops that disagree with all the rest.
    """

    trajectories: tuple[Trajectory, ...]
    maps: tuple[int, ...]
    used: tuple[LoopClosure, ...] = ()
    dropped: tuple[LoopClosure, ...] = ()

    def __post_init__(self) -> None:
        if len(self.maps) != len(self.trajectories):
            raise StructureError(
                f"{len(self.maps)} numbers of maps",
                want=f"one for each of {len(self.trajectories)} pieces",
                where="ClosedPath.maps",
            )
