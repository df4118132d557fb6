"""The topics of a recording: what they are about, and their messages by time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from pseudolidar.errors import PseudolidarError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.mcap.prolog import LIBRARY
from pseudolidar.formats.recordings.decoders import Decoder, Kind, kind_of, refusal, stamp_in_head
from pseudolidar.formats.recordings.message_store import MessageStore, Place
from pseudolidar.formats.recordings.messages import Mark, Message
from pseudolidar.structures.arrays import Int64

# Bytes of a message in which its stamp is looked for; whole marks of frames fit in, too.
HEAD_BYTES = 2048

AnyMessage = TypeVar("AnyMessage", bound=Message)


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic with what its messages are about.

    Args:
        name: of the topic.
        kind: what they are about.
        channels: (N,) position of each message's channel in the store.
        numbers: (N,) its number there.
        times_ns: (N,) times that they are filed under, not decreasing.
        latched: whether messages stay true until the next one.
    """

    name: str
    kind: Kind
    channels: Int64 = field(repr=False)
    numbers: Int64 = field(repr=False)
    times_ns: Int64 = field(repr=False)
    latched: bool = False

    def __len__(self) -> int:
        return len(self.times_ns)

    def place(self, number: int) -> Place:
        """Where message `number` is."""
        return int(self.channels[number]), int(self.numbers[number])


@dataclass(frozen=True, eq=False)
class Topics:
    """A recording by topics; picklable.

    Args:
        store: its messages.
        topics: those that can be read, by name.
        skipped: the others: name and number of messages, and why.
        limits: caps.
    """

    store: MessageStore
    topics: tuple[Topic, ...]
    skipped: tuple[tuple[str, str], ...]
    limits: Limits

    @classmethod
    def of(cls, store: MessageStore, limits: Limits) -> Topics:
        """Sort the channels of a store into topics."""
        groups: dict[tuple[str, Kind], list[int]] = {}
        skipped: dict[str, str] = {}
        for number, channel in enumerate(store.channels):
            kind = kind_of(channel)
            if kind is None:
                count = len(store.times_ns(number))
                skipped[f"{channel.topic} ({count} messages)"] = refusal(channel)
            else:
                groups.setdefault((channel.topic, kind), []).append(number)
        found = (_merged(store, name, kind, own) for (name, kind), own in groups.items())
        topics = tuple(sorted(found, key=lambda topic: topic.name))
        return cls(store, topics, tuple(sorted(skipped.items())), limits)

    @property
    def own(self) -> bool:
        """Whether this package wrote the recording."""
        return self.store.written_by == LIBRARY

    def of_kind(self, *kinds: Kind) -> tuple[Topic, ...]:
        """The topics about one of these."""
        return tuple(topic for topic in self.topics if topic.kind in kinds)

    def named(self, name: str, *kinds: Kind) -> Topic | None:
        """The topic of a name, if it is about one of these."""
        return next((topic for topic in self.of_kind(*kinds) if topic.name == name), None)

    def read(self, places: Sequence[Place]) -> list[Message]:
        """Decoded messages.

        Raises:
            RecordingError: damaged, or not what their schema says.
        """
        found = self.store.read(places)
        return [
            self._decoder(channel)(data) for (channel, _), data in zip(places, found, strict=True)
        ]

    def one(self, topic: Topic, number: int, kind: type[AnyMessage]) -> AnyMessage | None:
        """A message of a topic, None where it is damaged or of another kind."""
        try:
            (message,) = self.read([topic.place(number)])
        except PseudolidarError:
            return None
        return message if isinstance(message, kind) else None

    def name_in(self, channel: int, head: bytes | memoryview) -> str:
        """The name in a mark of a frame, "" where it cannot be read."""
        try:
            mark = self._decoder(channel)(head)
        except PseudolidarError:
            return ""
        return mark.name if isinstance(mark, Mark) else ""

    def stamps_ns(self, topic: Topic) -> Int64:
        """(N,) stamps in the messages of a topic; where one says none, when it was filed.

        Only their first bytes are read. In recordings of this package both times are one.
        """
        if self.own:
            return topic.times_ns
        stamps: dict[Place, int | None] = {}
        for channel in np.unique(topic.channels).tolist():
            heads = self.store.heads(channel, HEAD_BYTES)
            for number, head in enumerate(heads):
                stamps[channel, number] = stamp_in_head(self.store.channels[channel], head)
        missing = [place for place, stamp in stamps.items() if stamp is None]
        for place in missing:
            stamps[place] = self._whole_stamp(place)
        places = (topic.place(number) for number in range(len(topic)))
        return np.array(
            [stamps.get(p) or time for p, time in zip(places, topic.times_ns.tolist(), strict=True)]
        )

    def _whole_stamp(self, place: Place) -> int | None:
        try:
            return self.read([place])[0].stamp_ns if place else None
        except PseudolidarError:
            return None  # what is wrong is told when its frame is loaded
        except AttributeError:
            return None

    def _decoder(self, channel: int) -> Decoder:
        return Decoder(self.store.channels[channel], own=self.own, limits=self.limits)


def _merged(store: MessageStore, name: str, kind: Kind, channels: Iterable[int]) -> Topic:
    """The messages of all channels of a topic in one order."""
    own = list(channels)
    times = [store.times_ns(number) for number in own]
    order = np.argsort(np.concatenate(times), kind="stable")
    of_channel = np.concatenate(
        [np.full(len(part), number) for part, number in zip(times, own, strict=True)]
    )
    numbers = np.concatenate([np.arange(len(part)) for part in times])
    return Topic(
        name,
        kind,
        of_channel[order].astype(np.int64),
        numbers[order].astype(np.int64),
        np.concatenate(times)[order].astype(np.int64),
        any(store.channels[number].latched for number in own),
    )


def nearest_pairs(a_ns: Int64, b_ns: Int64, tolerance_ns: int) -> list[tuple[int, int]]:
    """Positions in `a_ns` and `b_ns` that are each other's nearest, up to the tolerance."""
    if not len(a_ns) or not len(b_ns):
        return []
    of_a, of_b = nearest(a_ns, b_ns), nearest(b_ns, a_ns)
    return [
        (at, int(b))
        for at, b in enumerate(of_a)
        if of_b[b] == at and abs(int(a_ns[at]) - int(b_ns[b])) <= tolerance_ns
    ]


def nearest(wanted_ns: Int64, given_ns: Int64) -> Int64:
    """(N,) position in `given_ns` of what is nearest to each of `wanted_ns`."""
    order = np.argsort(given_ns, kind="stable")
    given = given_ns[order]
    after = np.clip(np.searchsorted(given, wanted_ns), 0, len(given) - 1)
    before = np.maximum(after - 1, 0)
    earlier = np.abs(given[before] - wanted_ns) <= np.abs(given[after] - wanted_ns)
    return np.asarray(order[np.where(earlier, before, after)], np.int64)
