"""LiDAR scans put right: moved to one moment, their beams raised."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.geometry.scan_motion import at_one_moment, raised, turning_times_ns
from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.source import AnyFrame, FrameSequence
from pseudolidar.structures.frame import LidarScan, StereoFrame

Moment = Literal["trigger", "picture", "none"]
# More than this is no error of a LiDAR's own calibration.
LARGEST_TILT_DEG = 5.0
_MOMENTS = {
    "trigger": "the moment the LiDAR faces forward and triggers the cameras",
    "picture": "the time stamp of the picture",
}


@dataclass(frozen=True)
class Scans:
    """How the LiDAR's scans are put right before anything is compared with them.

    Args:
        deskew: where the source knows when points were taken and how the car moved (KITTI raw),
            move them to what the LiDAR sees from where it is at one moment: trigger, when it
            faces forward and triggers KITTI's cameras; picture, the time stamp of the picture,
            which KITTI's has 10 ms later; or none.
        tilt_deg: raise every beam by this angle. KITTI's HDL-64 wants 0.205 degrees for odometry;
            KITTI's calibration of the LiDAR to the cameras was made without, so depths want 0.
    """

    deskew: Moment = "trigger"
    tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.tilt_deg) <= LARGEST_TILT_DEG:
            raise UsageError(
                f"a tilt of {self.tilt_deg:g} degrees", want=f"{LARGEST_TILT_DEG:g} at most"
            )

    @property
    def note(self) -> str:
        """What is done, for people."""
        done = []
        if self.deskew != "none":
            done.append(f"moved by the IMU's motion to {_MOMENTS[self.deskew]}")
        if self.tilt_deg:
            done.append(f"beams raised by {self.tilt_deg:g} degrees")
        return f"scans: {', '.join(done)}"


def with_scans_put_right(
    source: FrameSequence[AnyFrame], scans: Scans | None
) -> FrameSequence[AnyFrame]:
    """The source with its scans as wanted, where anything is to be done to them."""
    wanted = None if scans is None else possible(source, scans)
    if wanted is None:
        return source
    return ChangedSource(source, wanted.note, partial(put_right, scans=wanted))


def possible(source: FrameSequence[Any], scans: Scans) -> Scans | None:
    """What of it can be done to the scans of a source; None for nothing."""
    deskew = scans.deskew if source.summary.turning_scans else "none"
    wanted = replace(scans, deskew=deskew)
    return None if wanted == Scans("none") else wanted


def put_right(frame: Any, *, scans: Scans) -> Any:
    """A pair with its scan put right, as far as it knows how; anything else as it is."""
    if not isinstance(frame, StereoFrame) or frame.scan is None:
        return frame
    scan = frame.scan
    if scans.tilt_deg:
        scan = replace(scan, xyz=raised(scan.xyz, math.radians(scans.tilt_deg)))
    if scans.deskew != "none":
        stamp_ns = None if scans.deskew == "trigger" else frame.timestamp_ns
        scan = deskewed(scan, frame, to_ns=stamp_ns)
    return replace(frame, scan=scan)


def deskewed(scan: LidarScan, frame: StereoFrame, *, to_ns: int | None = None) -> LidarScan:
    """A scan as if all its points were taken at one moment, while the world stood still.

    Nothing is done where nobody knows when they were taken, or how the rig moved. What moved by
    itself is moved as if it stood.

    Args:
        scan: of the frame, in the LiDAR's frame.
        frame: with its motion.
        to_ns: the moment; by default the time of the scan.

    Returns:
        The scan, without times of its points.
    """
    times_ns = scan.point_times_ns
    if times_ns is None and scan.turn_ns is not None:
        times_ns = turning_times_ns(scan.xyz, scan.turn_ns)
    T_left_lidar = frame.rig.T_left_velodyne
    if times_ns is None or frame.motion is None or T_left_lidar is None:
        return scan
    moment_ns = scan.timestamp_ns if to_ns is None else to_ns
    T_lidar_base = T_left_lidar.inverse() @ left_in_base_link(frame.rig).inverse()
    seconds = (times_ns - moment_ns).astype(np.float64) / NS_PER_S
    xyz = at_one_moment(scan.xyz, seconds, frame.motion.at(T_lidar_base))
    return replace(scan, xyz=xyz, timestamp_ns=moment_ns, point_times_ns=None, turn_ns=None)
