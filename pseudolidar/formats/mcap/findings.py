"""What a pass over a damaged recording has found: counts by topic, and every damaged place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from mcap.records import Attachment, Metadata

from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.mcap.records import MESSAGE_HEADER
from pseudolidar.formats.mcap.saved import Loss, SavedMessage

# Losses that are listed one by one; a hostile file may have millions.
LISTED = 1000


@dataclass
class Findings:
    """What a pass over a recording has found.

    Args:
        saved: messages by topic.
        unchecked: how many of them are from chunks that are cut or damaged.
        lost: messages by topic that are known to be lost.
        losses: damaged places in order, the first thousand.
        places: how many there are.
        lost_bytes: bytes in them.
        unknown: whether messages may be lost that nothing tells of.
        attachments: saved.
        metadata: saved.
        contents: CRC of every message with its topic and times, in order.
    """

    saved: Counter[str] = field(default_factory=Counter)
    unchecked: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    losses: list[Loss] = field(default_factory=list)
    places: int = 0
    lost_bytes: int = 0
    unknown: bool = False
    attachments: int = 0
    metadata: int = 0
    contents: int = 0

    @property
    def kept(self) -> tuple[Counter[str], int, int, int]:
        """What another recording of the same must have."""
        return self.saved, self.contents, self.attachments, self.metadata

    @property
    def intact(self) -> bool:
        """Nothing is wrong."""
        return not self.places

    @property
    def complete(self) -> bool:
        """No message is lost, or may be another than it was."""
        return not (self.lost or self.unknown or self.unchecked)

    def note(self, saved: object) -> None:
        """One thing that was saved, or lost."""
        match saved:
            case SavedMessage():
                self.add_message(
                    saved.channel.topic,
                    saved.sequence,
                    saved.log_time_ns,
                    saved.publish_time_ns,
                    saved.data,
                )
                self.unchecked += saved.damaged
            case Loss():
                self.add_loss(saved)
            case Attachment():
                self.attachments += 1
            case Metadata():
                self.metadata += 1

    def add_message(
        self, topic: str, sequence: int, log_time_ns: int, publish_time_ns: int, data: memoryview
    ) -> None:
        """A message was saved, or read back."""
        self.saved[topic] += 1
        head = MESSAGE_HEADER.pack(0, sequence, log_time_ns, publish_time_ns)
        self.contents = crc32(data, crc32(head, crc32(topic.encode(), self.contents)))

    def add_loss(self, loss: Loss) -> None:
        """A place is damaged."""
        self.places += 1
        self.lost_bytes += loss.nbytes
        if loss.messages is not None:
            self.lost.update(loss.messages)
        elif loss.nbytes:
            self.unknown = True
        if len(self.losses) < LISTED:
            self.losses.append(loss)

    def settle(self, claimed: Mapping[str, int] | None) -> None:
        """What the summary claims settles what is lost, where it is left."""
        if claimed is not None:
            missing = Counter(claimed)
            missing.subtract(self.saved)
            self.lost = Counter({topic: n for topic, n in missing.items() if n > 0})
            self.unknown = False
