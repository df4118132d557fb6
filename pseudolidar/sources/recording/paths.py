"""Paths that a recording tells by itself: the poses of its topics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.formats.recordings.messages import StampedPose, Transforms
from pseudolidar.formats.recordings.recording_store import open_store
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.recording.topics import Topic, Topics
from pseudolidar.structures.arrays import Float64


@dataclass(frozen=True, eq=False)
class RecordedPath:
    """The poses of a topic.

    Args:
        topic: its name.
        frame: that they are in, such as `odom`.
        places_m: (N, 3) in the order in which they were filed; N > 0, all finite.
    """

    topic: str
    frame: str
    places_m: Float64


def paths_alone(settings: Recording) -> tuple[RecordedPath, ...]:
    """The paths of a recording that has nothing else to be seen, the longest first.

    Messages that cannot be read are left out.

    Returns:
        One for each topic of poses; none of a recording with pictures or clouds.

    Raises:
        RecordingError: nothing of it can be read.
    """
    topics = Topics.of(open_store(Path(settings.path), limits=settings.limits), settings.limits)
    if topics.of_kind("picture", "cloud"):
        return ()
    found = (_path(topics, topic) for topic in topics.of_kind("pose"))
    return tuple(sorted((path for path in found if path), key=lambda path: -len(path.places_m)))


def _path(topics: Topics, topic: Topic) -> RecordedPath | None:
    """The poses in the frame of the first one; None where no message can be read."""
    read = (topics.one(topic, number, Transforms) for number in range(len(topic)))
    poses = [one.poses[0].pose for one in read if one is not None and _has_place(one.poses)]
    if not poses:
        return None
    frame = poses[0].dst
    places = [pose.translation_m for pose in poses if pose.dst == frame]
    return RecordedPath(topic.name, frame, np.array(places))


def _has_place(poses: tuple[StampedPose, ...]) -> bool:
    return bool(poses) and bool(np.isfinite(poses[0].pose.translation_m).all())
