"""What is saved of a damaged recording, and what is lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from mcap.records import Attachment, Channel, Header, Metadata, Schema


@dataclass(frozen=True, eq=False)
class SavedMessage:
    """A whole message.

    Args:
        channel: what it was sent on.
        schema: of the channel; None where that has none, or it is lost.
        sequence: counter of its publisher.
        log_time_ns: time it is filed under.
        publish_time_ns: time it was sent.
        data: serialised message.
        damaged: it is from a chunk that is cut or damaged: nothing tells whether it is as it was.
    """

    channel: Channel
    schema: Schema | None
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: memoryview
    damaged: bool = False


@dataclass(frozen=True)
class Loss:
    """Bytes that nothing is saved of, or not all.

    Args:
        offset: first byte.
        nbytes: how many.
        reason: what is wrong.
        messages: how many were in it by topic, where an index tells; None where nothing does.
    """

    offset: int
    nbytes: int
    reason: str
    messages: Mapping[str, int] | None = None


Saved: TypeAlias = Header | SavedMessage | Attachment | Metadata | Loss


@dataclass
class Declared:
    """What channels mean.

    Args:
        schemas: by identifier.
        channels: by identifier.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
