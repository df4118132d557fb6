"""Where the sensors were: by vision, by KISS-ICP on scans, or by both and what they check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from pseudolidar.mapping.extrapolating import ExtrapolatingChain
from pseudolidar.mapping.registered import Registered
from pseudolidar.mapping.scan_odometry import ScanOdometry
from pseudolidar.mapping.visual_odometry import VisualChain, VisualOdometry
from pseudolidar.structures.box import Detection
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.correction import DisparityCorrection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Trajectory


@dataclass(frozen=True)
class Vision:
    """Stereo visual odometry alone.

    Args:
        visual: its settings.
    """

    visual: VisualOdometry = field(default_factory=VisualOdometry)

    def start(self, rig: StereoRig) -> ExtrapolatingChain:
        """Begin with the first frame to come."""
        return ExtrapolatingChain(VisionChain(self.visual.start(rig)), reach=self.visual.reach)


@dataclass(frozen=True)
class Kiss:
    """KISS-ICP on the scans of a LiDAR, with the vision left out.

    Args:
        scans: its settings.
    """

    scans: ScanOdometry = field(default_factory=ScanOdometry)

    def start(self, rig: StereoRig) -> ExtrapolatingChain:
        """Begin with the first frame to come.

        Raises:
            MissingDependency: kiss-icp is absent.
        """
        from pseudolidar.mapping.kiss_chain import KissChain

        return ExtrapolatingChain(KissChain(self.scans.start(), rig), reach=self.scans.reach)


@dataclass(frozen=True)
class Fused:
    """Stereo visual odometry whose every step is checked and laid on KISS-ICP's map.

    Frames that have a scan of a LiDAR are laid on the map of scans instead of that of patches; what
    vision loses is laid there by its scan alone.

    Args:
        visual: settings of vision.
    """

    visual: VisualOdometry = field(default_factory=VisualOdometry)

    def start(self, rig: StereoRig) -> ExtrapolatingChain:
        """Begin with the first frame to come.

        Raises:
            MissingDependency: kiss-icp is absent.
        """
        from pseudolidar.mapping.fused_chain import FusedChain

        chain = FusedChain(self.visual.start(rig), rig, reach=self.visual.reach)
        return ExtrapolatingChain(chain, reach=self.visual.reach)


Odometry: TypeAlias = Vision | Kiss | Fused


class VisionChain:
    """Vision alone as `Registered` has it.

    Args:
        visual: begun.
    """

    def __init__(self, visual: VisualChain) -> None:
        self._visual = visual

    def register(
        self, frame: StereoFrame, disparity: DisparityMap, movable: Sequence[Detection] = ()
    ) -> Registered:
        """Where the next frame was taken."""
        state = self._visual.register(frame, disparity, movable)
        return Registered(state, sensors="vision" if state.measured else "none")

    @property
    def correction(self) -> DisparityCorrection | None:
        """What should be taken off disparities by now."""
        return self._visual.correction

    @property
    def scan_counts(self) -> None:
        """Scans are not looked at."""
        return None

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Poses with all that is known by now, and covariances, piece by piece."""
        return self._visual.trajectories()
