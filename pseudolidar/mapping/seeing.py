"""What fused odometry wants of vision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from pseudolidar.mapping.disparity_offset import Offset
from pseudolidar.structures.box import Detection
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import OdometryState
from pseudolidar.structures.pose import Trajectory


class Seeing(Protocol):
    """What tells steps by pictures, as `VisualChain` does."""

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now."""
        ...

    @property
    def offset(self) -> Offset:
        """What is known of the rig's disparity offset by now."""
        ...

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> OdometryState:
        """Where the next frame was taken."""
        ...

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses with all that is known by now, piece by piece."""
        ...
