"""A profile of recordings: which topics there are, of which schemas, and who writes their messages.

Identifiers are positions in a profile's tables, the same in every file, so that a frame can be
packed without knowing the frames before it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mcap.records import Channel
from mcap.records import Schema as SchemaRecord

from pseudolidar.formats.mcap.items import Kind
from pseudolidar.formats.mcap.records import Parts, record_bytes


@dataclass(frozen=True, eq=False)
class Schema:
    """A schema of messages.

    Args:
        name: as the file names it.
        encoding: `protobuf` or `ros2msg`.
        data: the schema with all that it refers to.
    """

    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic of a recording.

    Args:
        name: topic.
        kind: what it shows of a frame.
        schema: of its messages.
        encode: from a thing of that kind and a time stamp (ns) to a message, None for nothing.
        meaning: units and conventions, stored with the channel.
    """

    name: str
    kind: Kind
    schema: Schema
    encode: Callable[[Any, int], Parts | None]
    meaning: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Profile:
    """A profile.

    Args:
        name: as in the settings.
        header: as the file's header names it.
        encoding: of the messages.
        topics: append, never reorder; the first is the mark of the frame.
        frame_name: the frame that a message of the first topic marks.
    """

    name: str
    header: str
    encoding: str
    topics: tuple[Topic, ...]
    frame_name: Callable[[bytes], str]

    MARK_ID = 1

    @functools.cached_property
    def _schemas(self) -> tuple[Schema, ...]:
        """Each once, in the order in which topics name them."""
        return tuple(dict.fromkeys(topic.schema for topic in self.topics))

    @functools.cached_property
    def _topics_of(self) -> dict[Kind, tuple[tuple[int, Topic], ...]]:
        numbered = tuple(enumerate(self.topics, start=1))
        return {kind: tuple(p for p in numbered if p[1].kind is kind) for kind in Kind}

    def topics_of(self, kind: Kind) -> tuple[tuple[int, Topic], ...]:
        """The topics that show such a thing, with their identifiers."""
        return self._topics_of[kind]

    def topic(self, channel: int) -> Topic:
        """The topic of an identifier."""
        return self.topics[channel - 1]

    def schema_id(self, channel: int) -> int:
        """Identifier of the schema of a channel."""
        return self._schemas.index(self.topic(channel).schema) + 1

    @functools.cached_property
    def channel_records(self) -> dict[int, bytes]:
        """The channel record of each identifier."""
        return {
            number: record_bytes(
                Channel(
                    id=number,
                    topic=topic.name,
                    message_encoding=self.encoding,
                    metadata=dict(topic.meaning),
                    schema_id=self.schema_id(number),
                )
            )
            for number, topic in enumerate(self.topics, start=1)
        }

    @functools.cached_property
    def schema_records(self) -> dict[int, bytes]:
        """The schema record of each identifier of a schema."""
        return {
            number: record_bytes(
                SchemaRecord(id=number, name=s.name, encoding=s.encoding, data=s.data)
            )
            for number, s in enumerate(self._schemas, start=1)
        }

    def declarations(self, channels: set[int]) -> bytes:
        """Records of the schemas and then of the channels."""
        schemas = sorted({self.schema_id(number) for number in channels})
        return b"".join(
            [
                *(self.schema_records[number] for number in schemas),
                *(self.channel_records[number] for number in sorted(channels)),
            ]
        )
