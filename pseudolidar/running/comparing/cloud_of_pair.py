"""The cloud of a pair against a scan, or against a cloud of another source, point by point."""

from __future__ import annotations

from dataclasses import dataclass

from pseudolidar.evaluation.cloud_distances import CloudDistances
from pseudolidar.evaluation.scan_distances import distances_to_scan
from pseudolidar.running.comparing.clouds import MOST_ASKED
from pseudolidar.running.comparing.references import Reference
from pseudolidar.running.matching import MatchFrame
from pseudolidar.stereo.reproject import Reproject, Reprojector
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame


@dataclass(frozen=True)
class CompareCloudOfPair:
    """Makes the cloud of a pair as `convert` does, and compares it: pure, picklable, one thread.

    Args:
        match: pair to the disparities that become points.
        reproject: disparity to points.
        reference: what the cloud is compared with, as a scan.
    """

    match: MatchFrame
    reproject: Reprojector
    reference: Reference

    def __call__(self, frame: StereoFrame) -> CloudDistances | None:
        """Distances in the common field of view; None without a reference.

        Raises:
            PairIdentical, LowTexture: there is nothing to be seen.
            CalibrationField: nobody knows where the scan was taken.
        """
        found = self.reference(frame)
        if found is None:
            return None
        cloud = self.reproject(found, self.match.disparity(found))
        return distances_of(cloud, found, self.reproject.settings)


def distances_of(cloud: PointCloud, frame: StereoFrame, kept: Reproject) -> CloudDistances:
    """Distances between the cloud of a pair and its scan, at the ranges that clouds hold.

    Args:
        cloud: of this frame, in the left camera's frame.
        frame: with a scan.
        kept: which pixels became points.

    Raises:
        CalibrationField: nobody knows where the scan was taken.
    """
    range_m = kept.min_range_m, kept.max_range_m
    return distances_to_scan(cloud, frame, range_m=range_m, most=MOST_ASKED)
