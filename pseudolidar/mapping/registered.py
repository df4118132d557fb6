"""What every kind of odometry tells of a frame, and of the whole path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from pseudolidar.structures.box import Detection
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.odometry import OdometryState
from pseudolidar.structures.pose import Trajectory

if TYPE_CHECKING:
    from pseudolidar.mapping.alignment import Alignment
    from pseudolidar.mapping.integrity import StepCheck
    from pseudolidar.mapping.scan_counts import ScanCounts

# By which sensors a pose was measured.
Sensors = Literal["none", "vision", "scan", "vision and scan"]


@dataclass(frozen=True, eq=False)
class Registered:
    """What odometry tells of a frame.

    Args:
        state: as vision tells it, of the pose that is right in the end.
        check: what other witnesses said of vision's step; None where there was none.
        alignment: how the frame lies on the map; None without a map.
        sensors: by which its pose was measured; `none` where it was not.
    """

    state: OdometryState
    check: StepCheck | None = None
    alignment: Alignment | None = None
    sensors: Sensors = "none"

    @property
    def by_scan(self) -> bool:
        """Whether the alignment is of the frame's scan on the map of scans, and not of patches."""
        return self.sensors in ("scan", "vision and scan")


class OdometryChain(Protocol):
    """Follows a rig through its frames."""

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now: for the rig, and for every cloud."""
        ...

    @property
    def scan_counts(self) -> ScanCounts | None:
        """What was odd about scans so far; None where scans are not looked at."""
        ...

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> Registered:
        """Where the next frame was taken.

        Args:
            frame: of the same rig as all, later than the one before.
            disparity: of its left image, as matched: no correction taken off.
            movable: things in its left image that may move by themselves.

        Raises:
            SequenceTime: the frame is not later than the one before.
        """
        ...

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses of the left camera in `odom` at all frames that were not lost, with covariances.

        One trajectory for each piece of path, in order; early poses are put right with what is
        known by now, so they are better than what `register` could tell at their time.
        """
        ...
