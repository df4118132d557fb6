"""Ready-made clouds against their scans, or against the clouds of another source."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from pseudolidar.errors import CalibrationField, SourceUnknown
from pseudolidar.evaluation.cloud_distances import CloudDistances, cloud_distances
from pseudolidar.geometry.cloud_frames import carried, turned_forward
from pseudolidar.geometry.frame_chain import ancestors, chain
from pseudolidar.geometry.frames import BASE_LINK, MAP, ODOM
from pseudolidar.running.comparing.partners import partners_of
from pseudolidar.running.comparing.references import SCAN, WORDS
from pseudolidar.sources.recognise import recognise
from pseudolidar.sources.source import FrameSequence, clouds_of
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.recorded import RecordedCloud

_log = logging.getLogger(__name__)

# Points of each cloud whose neighbours are looked for; a dense stereo cloud has 300 000.
MOST_ASKED = 50_000
# Frames that are no sensor's: directions in them mean nothing.
STANDING = (MAP, ODOM)


@dataclass(frozen=True)
class CompareClouds:
    """Nearest neighbours between a cloud and its reference: pure, picklable, one thread.

    Args:
        words: what the reference is, for people.
        other: the reference's clouds; None where the frames' own scans are it.
        partners: index there by the id of our frame.
    """

    words: str
    other: FrameSequence[RecordedCloud] | None = None
    partners: Mapping[str, int] = field(default_factory=dict)

    def __call__(self, frame: RecordedCloud) -> CloudDistances | None:
        """Distances; None without a reference.

        Raises:
            CalibrationField: no transforms between the two clouds.
        """
        reference = self._reference(frame)
        if reference is None:
            return None
        sensor = BASE_LINK if frame.cloud.frame in STANDING else frame.cloud.frame
        return cloud_distances(
            _in_sensor(frame, sensor), _in_sensor(reference, sensor), most=MOST_ASKED
        )

    def _reference(self, frame: RecordedCloud) -> RecordedCloud | None:
        if self.other is None:
            if frame.scan is None:
                return None
            scan = frame.scan
            return replace(frame, cloud=PointCloud(scan.xyz, scan.frame, scan.timestamp_ns))
        if frame.id not in self.partners:
            return None
        return self.other.load(self.partners[frame.id])


def _in_sensor(frame: RecordedCloud, sensor: str) -> AnyArray:
    """(N, 3) points in the sensor's frame, x forward.

    Raises:
        CalibrationField: no transforms lead there.
    """
    T_sensor_cloud = chain(frame.tree, sensor, frame.cloud.frame)
    if T_sensor_cloud is None:
        raise CalibrationField(
            f"a cloud in {frame.cloud.frame!r}, and no transforms from there to {sensor!r}",
            want=f"one of {', '.join(ancestors(frame.tree, frame.cloud.frame))}",
            fix="Write both clouds in one frame, or record the transforms with them.",
            where=f"frame {frame.id}",
        )
    return turned_forward(carried(frame.cloud, T_sensor_cloud)).xyz


OWN_SCANS = CompareClouds(WORDS[SCAN])


def other_clouds(text: str, source: FrameSequence[RecordedCloud]) -> CompareClouds:
    """The clouds of another source as the reference of `source`.

    Raises:
        NoClouds: it has something else.
        SourceEmpty: or no frame of ours.
    """
    other = clouds_of(recognise(text).open())
    partners = partners_of(source, other)
    _log.info("reference: %s", other.summary.line)
    _log.info("paired: %s", partners.how)
    return CompareClouds(text, other, partners.indices)


def holds_clouds(text: str) -> bool:
    """Whether another source has ready-made clouds, and not pairs, depth or maps."""
    try:
        return recognise(text).open().yields is RecordedCloud
    except SourceUnknown:
        return False
