"""Recordings as sources: MCAP of this package, of Foxglove and of ROS 2, and ROS bags."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.recordings.kinds import recording_kind
from pseudolidar.formats.rigs.rig_reading import Pictures, RigUnit
from pseudolidar.sources.source import FrameSequence
from pseudolidar.structures.recorded import HeldFrame

Take = Literal["auto", "pairs", "clouds", "depth"]


@dataclass(frozen=True)
class Recording:
    """An MCAP, a ROS 2 bag (folder or `.db3`) or a ROS 1 bag.

    Taken are the clouds of recordings of this package; of others the pairs of a calibrated stereo
    camera where there is one (rectified ones first), else the clouds, else pictures with depth.
    What was taken is said. Left and right are known by their calibration (the projection's fourth
    column); pictures are paired by the stamps in them. The nearest LiDAR cloud becomes the scan of
    a pair, the transforms its pose.

    Args:
        path: file, or folder of a ROS 2 bag.
        take: pairs, clouds, or pictures with depth.
        topic: topic of the clouds.
        topics: topics of left and right pictures, `LEFT,RIGHT`.
        rig: calibration file, for pictures without calibration, or instead of it.
        rig_unit: unit of lengths in a calibration file that does not say it.
        scale_calibration: scale that calibration where pictures have another size.
        pictures: raw or rectified, where both are there or a calibration knows both.
        tolerance_s: pictures are paired up to this difference of their stamps.
        limits: caps on what the recording may claim.
    """

    path: str
    take: Take = "auto"
    topic: str | None = None
    topics: str | None = None
    rig: str | None = None
    rig_unit: RigUnit | None = None
    scale_calibration: bool = False
    pictures: Pictures = "auto"
    tolerance_s: float = 0.005
    limits: Limits = DEFAULT_LIMITS

    def open(self) -> FrameSequence[HeldFrame]:
        """List topics and frames, read the calibration; no picture and no cloud is decoded.

        Raises:
            RecordingError: nothing of it can be read.
            SourceEmpty: no pair, no cloud and no depth in it.
            NotRectified, CalibrationMissing: pairs that cannot be used, and nothing else; rectified
                ones asked for, and only raw ones there.
            UsageError: a topic that is not there.
        """
        from pseudolidar.sources.recording.take import open_recording

        return open_recording(self)

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` is a recording, by its content."""
        return recording_kind(path) != ""
