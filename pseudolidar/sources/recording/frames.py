"""Where coordinate frames are at a moment of a recording, by its transforms."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.recordings.message_store import Place
from pseudolidar.formats.recordings.messages import Message, StampedPose, Transforms
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frame_chain import between
from pseudolidar.sources.recording.topics import Topic, Topics
from pseudolidar.structures.pose import Pose

# The beginning of a topic by which its publishers are known.
LEARNED_MESSAGES, LEARNED_NS = 200, 2 * NS_PER_S
# Messages on either side of a moment that are read at most.
MOST_AROUND = 500
MOST_STATIC_MESSAGES = 100
# A transform this much older or newer than the moment still counts, as it does in tf2's buffers.
OLDEST_NS = NS_PER_S
# Stamps further from the time of filing are by another clock: that of a simulation.
LONGEST_DELAY_NS = 10 * NS_PER_S


@dataclass(frozen=True, eq=False)
class RecordedFrames:
    """The transforms of a recording; only those around a moment are read for it.

    Args:
        static: `T_parent_child` that always hold.
        moving: topics whose transforms change, with how many messages around a moment are needed.
    """

    static: tuple[Pose, ...] = ()
    moving: tuple[tuple[Topic, int], ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, topics: Topics) -> RecordedFrames:
        """Read what always holds, and learn from the first messages how often the rest comes."""
        static: dict[str, Pose] = {}
        moving: list[tuple[Topic, int]] = []
        for topic in topics.of_kind("transforms"):
            if topics.own:
                moving.append((topic, 0))  # everything of a frame is filed under its time
            elif topic.latched:
                static |= _all_of(topics, topic)
            else:
                moving.append((topic, _around(topics, topic)))
        if not moving and not topics.own:
            moving = [(topic, 2) for topic in topics.of_kind("pose")]
        return cls(tuple(static.values()), tuple(moving))

    def places(self, stamp_ns: int, filed_ns: int) -> list[Place]:
        """The messages that are needed for a moment.

        Args:
            stamp_ns: the moment.
            filed_ns: when what shows it was filed; stamps may be by another clock.
        """
        same_clock = abs(stamp_ns - filed_ns) <= LONGEST_DELAY_NS
        found = []
        for topic, around in self.moving:
            at = int(np.searchsorted(topic.times_ns, stamp_ns if same_clock else filed_ns))
            found += [
                topic.place(number)
                for number in range(max(at - around, 0), min(at + around + 1, len(topic)))
            ]
        return found

    def tree(self, messages: Iterable[Message], stamp_ns: int) -> tuple[Pose, ...]:
        """`T_parent_child` of every child at a time.

        Args:
            messages: those of `places`.
            stamp_ns: the time.
        """
        samples: dict[str, list[StampedPose]] = {}
        for message in messages:
            if isinstance(message, Transforms):
                for sample in message.poses:
                    samples.setdefault(sample.pose.src, []).append(sample)
        tree = {pose.src: pose for pose in self.static}
        for child, own in samples.items():
            pose = _at(own, stamp_ns)
            if pose is not None:
                tree[child] = pose
        return tuple(tree.values())


def _at(samples: list[StampedPose], stamp_ns: int) -> Pose | None:
    """The pose at a time, None where no sample is near enough."""
    own = sorted(samples, key=lambda sample: sample.stamp_ns)
    before = [sample for sample in own if sample.stamp_ns <= stamp_ns]
    after = [sample for sample in own if sample.stamp_ns >= stamp_ns]
    if before and after:
        early, late = before[-1], after[0]
        span_ns = late.stamp_ns - early.stamp_ns
        if span_ns == 0 or early.pose.dst != late.pose.dst:
            return early.pose
        return between(early.pose, late.pose, (stamp_ns - early.stamp_ns) / span_ns)
    nearest = before[-1] if before else after[0]
    return nearest.pose if abs(nearest.stamp_ns - stamp_ns) <= OLDEST_NS else None


def _all_of(topics: Topics, topic: Topic) -> dict[str, Pose]:
    found: dict[str, Pose] = {}
    for number in range(min(len(topic), MOST_STATIC_MESSAGES)):
        message = topics.one(topic, number, Transforms)
        for sample in message.poses if message else ():
            found[sample.pose.src] = sample.pose
    return found


def _around(topics: Topics, topic: Topic) -> int:
    """Messages that lie between two of the same child, at most."""
    last: dict[str, int] = {}
    widest = 1
    early = int(np.searchsorted(topic.times_ns, topic.times_ns[0] + LEARNED_NS))
    places = [topic.place(number) for number in range(min(early, LEARNED_MESSAGES))]
    try:
        messages = topics.read(places)
    except PseudolidarError:
        return widest + 1
    for number, message in enumerate(messages):
        for sample in message.poses if isinstance(message, Transforms) else ():
            widest = max(widest, number - last.get(sample.pose.src, number))
            last[sample.pose.src] = number
    return min(widest + 1, MOST_AROUND)
