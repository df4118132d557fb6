"""The paths in a recording that holds poses alone, such as those of a robot's odometry."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pseudolidar.formats.recordings.messages import Transforms
from pseudolidar.formats.recordings.recording_store import open_store
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.sources.recording.topics import Topic, Topics
from pseudolidar.structures.arrays import Float64


@dataclass(frozen=True, eq=False)
class RecordedPath:
    """Where the poses of a topic are.

    Args:
        topic: its name.
        frame: the frame that the poses are in, such as `odom`.
        places_m: (N, 3) m, in the order in which they were filed; N > 0, all finite.
    """

    topic: str
    frame: str
    places_m: Float64


def paths_alone(settings: Recording) -> tuple[RecordedPath, ...]:
    """The paths of a recording that has neither pictures nor clouds, that of most poses first.

    Messages that cannot be read are left out, as those of places that are not finite. Every message
    is read: 0.1 ms each.

    Args:
        settings: which recording.

    Returns:
        One path for each topic of poses, not of transforms; none if there are pictures or clouds.

    Raises:
        RecordingError: nothing of it can be read.
    """
    topics = Topics.of(open_store(Path(settings.path), limits=settings.limits), settings.limits)
    if topics.of_kind("picture", "cloud"):
        return ()
    found = (_path(topics, topic) for topic in topics.of_kind("pose"))
    return tuple(sorted((path for path in found if path), key=lambda path: -len(path.places_m)))


def _path(topics: Topics, topic: Topic) -> RecordedPath | None:
    """The poses that are in the frame of the first one; None where no message can be read."""
    read = (topics.one(topic, number, Transforms) for number in range(len(topic)))
    poses = [one.poses[0].pose for one in read if one is not None]  # a message holds one
    if not poses:
        return None
    frame = poses[0].dst
    places = [pose.translation_m for pose in poses if pose.dst == frame]
    return RecordedPath(topic.name, frame, np.array(places))
