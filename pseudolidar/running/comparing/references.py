"""What the frames of a source are compared with: their scans, their truth, another source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from pseudolidar.errors import CalibrationField, NoPairs, StructureError
from pseudolidar.geometry.depth import depth_map
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.geometry.triangulation import disparity_from_depth
from pseudolidar.sources.source import FrameSequence
from pseudolidar.stereo.matcher import StereoMatcher
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.body import BodyFrame
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.recorded import DepthFrame, Frame, RecordedCloud

OwnKind = Literal["auto", "scan", "truth"]
SCAN, TRUTH = "scan", "truth"
# How references are called, for people.
WORDS = {SCAN: "LiDAR scans", TRUTH: "ground-truth disparities"}


class Reference(Protocol):
    """Finds what a frame is compared with; pure, picklable."""

    def __call__(self, frame: StereoFrame) -> StereoFrame | None:
        """The frame with either a scan or a true disparity; None where it has no reference.

        Raises:
            CalibrationField: nobody knows where the scan was taken.
        """


def kind_of(frame: StereoFrame) -> str:
    """Which of both a frame from a `Reference` has."""
    return TRUTH if frame.scan is None else SCAN


@dataclass(frozen=True)
class OwnReference:
    """What the source itself has.

    Args:
        kind: the scan, the truth, or the scan where there is one and the truth elsewhere.
    """

    kind: OwnKind = "auto"

    def __call__(self, frame: StereoFrame) -> StereoFrame | None:
        """The frame without the other one."""
        placed = frame.scan is not None and _is_placed(frame.scan, frame.rig)
        scanned = frame.scan is not None and self.kind != TRUTH
        if scanned and (placed or self.kind == SCAN or frame.truth is None):
            return replace(frame, truth=None)
        if frame.truth is not None and self.kind != SCAN:
            return replace(frame, scan=None)
        return None


def _is_placed(scan: LidarScan, rig: StereoRig) -> bool:
    at = rig.T_left_velodyne
    return scan.frame == rig.left.frame or (at is not None and at.src == scan.frame)


@dataclass(frozen=True)
class OtherSource:
    """The frames of another source: clouds become scans, depth and matched pairs the truth.

    Args:
        source: where they come from.
        partners: index there by the id of our frame.
        matcher: how the disparities of its pairs are found; None for a source of clouds.
    """

    source: FrameSequence[Frame]
    partners: Mapping[str, int]
    matcher: StereoMatcher | None = None

    def __call__(self, frame: StereoFrame) -> StereoFrame | None:
        """The frame with what the other source has at its place.

        Raises:
            CalibrationField: a cloud in a frame that no transforms lead to.
            StructureError: pictures of another size.
        """
        if frame.id not in self.partners:
            return None
        match self.source.load(self.partners[frame.id]):
            case RecordedCloud() as other:
                return replace(frame, scan=as_scan(other, frame.rig), truth=None)
            case DepthFrame(depth=depth):
                return replace(frame, scan=None, truth=disparities_of(depth, frame))
            case StereoFrame() as pair:
                assert self.matcher is not None
                depth = depth_map(self.matcher(pair), pair.rig)
                return replace(frame, scan=None, truth=disparities_of(depth, frame))
            case BodyFrame():
                raise NoPairs("pairs of several rigs", want="pairs of one rig, clouds, or depths")


@dataclass(frozen=True)
class OtherMaps:
    """Disparity maps in files, as the truth.

    Args:
        maps: reads the map of a frame; raises where it has none.
        known: ids of the frames that have one.
    """

    maps: StereoMatcher
    known: frozenset[str]

    def __call__(self, frame: StereoFrame) -> StereoFrame | None:
        """The frame with its map, the rig's correction taken off as it will be of ours."""
        if frame.id not in self.known:
            return None
        depth = depth_map(self.maps(frame), frame.rig)
        return replace(frame, scan=None, truth=disparities_of(depth, frame))


def as_scan(other: RecordedCloud, rig: StereoRig) -> LidarScan:
    """A cloud as the scan of a rig.

    Raises:
        CalibrationField: no transforms lead from its frame to the rig's.
    """
    cloud = other.cloud if other.cloud.shape is None else other.cloud[other.cloud.valid]
    velodyne = rig.T_left_velodyne
    known = [rig.left.frame] if velodyne is None else [velodyne.src, rig.left.frame]
    for name in known:
        T_known_cloud = chain(other.tree, name, cloud.frame)
        if T_known_cloud is not None:
            xyz = T_known_cloud.apply(cloud.xyz).astype(np.float32)
            return LidarScan(xyz, cloud.intensity, other.timestamp_ns, name)
    raise CalibrationField(
        f"a cloud in {cloud.frame!r}, and no transforms from there",
        want=f"one in {' or '.join(known)}",
        fix="Write the clouds in one of these frames, or record the transforms with them.",
        where=f"frame {other.id} of the reference",
    )


def disparities_of(depth: DepthMap, frame: StereoFrame) -> DisparityMap:
    """True disparities that a frame's rig has for depths of its left image's pixels.

    Raises:
        StructureError: the depths are of pictures of another size.
    """
    height, width = depth.values.shape
    if (width, height) != frame.size_px:
        raise StructureError(
            f"a reference of {width}x{height}",
            want=f"{frame.size_px[0]}x{frame.size_px[1]}, the picture's size",
            where=f"frame {frame.id}",
        )
    u = np.arange(width, dtype=np.float64)[None, :]
    true_px: Float64 = disparity_from_depth(depth.values.astype(np.float64), u, frame.rig)
    return DisparityMap(true_px.astype(np.float32))
