"""Messages of a recording by channel and number, whatever container they are in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from pseudolidar.errors import RecordingError
from pseudolidar.structures.arrays import Int64

# What a store says that its messages are serialised as.
PROTOBUF, JSON, CDR, ROS1 = "protobuf", "json", "cdr", "ros1"
# What notes on messages begin with that the container held and nobody can read any more.
LOST = "lost: "


@dataclass(frozen=True)
class Channel:
    """A stream of messages of one topic.

    Args:
        topic: its topic.
        schema: name of the type of its messages.
        definition: of that type, as the container holds it; empty where it holds none.
        definition_encoding: of the definition: `protobuf`, `jsonschema`, `ros2msg`, `ros2idl`,
            `ros1msg` or "".
        encoding: of the messages.
        latched: whether its messages stay true: late subscribers get the last one.
    """

    topic: str
    schema: str
    definition: bytes = field(repr=False)
    definition_encoding: str
    encoding: str
    latched: bool = False


# A message: position of its channel in the store, and its number in the channel, by time.
Place = tuple[int, int]


class MessageStore(Protocol):
    """An opened recording; picklable, to be read from any thread or process."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What is damaged; what is missing for it begins with `LOST`."""

    @property
    def written_by(self) -> str:
        """The program that wrote it, "" where that is unknown."""

    def attachment(self, name: str) -> bytes:
        """A file that the recording carries before its messages, empty where it has none."""

    def times_ns(self, channel: int) -> Int64:
        """(N,) times that the messages of a channel are filed under, not decreasing."""

    def read(self, places: Sequence[Place]) -> list[bytes | memoryview]:
        """Messages, checked as well as the container allows.

        Raises:
            RecordingError: damaged; says where in the file.
        """

    def heads(self, channel: int, size: int) -> Iterator[bytes | memoryview]:
        """First bytes of each message of a channel in order, at least `size` where it has them.

        What is read is not checked: it is for looking at, and found out when the message is read.
        """


@dataclass(frozen=True, eq=False)
class JoinedStore:
    """Several files of one recording.

    Args:
        stores: in the order of time.
    """

    stores: tuple[MessageStore, ...]

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of all files, one file after the other."""
        return tuple(channel for store in self.stores for channel in store.channels)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is damaged in any file."""
        return tuple(note for store in self.stores for note in store.notes)

    @property
    def written_by(self) -> str:
        """The program that wrote the first file."""
        return self.stores[0].written_by

    def attachment(self, name: str) -> bytes:
        """That of the first file."""
        return self.stores[0].attachment(name)

    def times_ns(self, channel: int) -> Int64:
        """(N,) times of the messages of a channel."""
        store, number = self._own(channel)
        return store.times_ns(number)

    def read(self, places: Sequence[Place]) -> list[bytes | memoryview]:
        """Messages; of each file at once."""
        found: dict[int, bytes | memoryview] = {}
        by_store: dict[int, list[int]] = {}
        for at, (channel, _) in enumerate(places):
            by_store.setdefault(id(self._own(channel)[0]), []).append(at)
        for chosen in by_store.values():
            store = self._own(places[chosen[0]][0])[0]
            own = [(self._own(places[at][0])[1], places[at][1]) for at in chosen]
            found |= dict(zip(chosen, store.read(own), strict=True))
        return [found[at] for at in range(len(places))]

    def heads(self, channel: int, size: int) -> Iterator[bytes | memoryview]:
        """First bytes of each message of a channel."""
        store, number = self._own(channel)
        return store.heads(number, size)

    def _own(self, channel: int) -> tuple[MessageStore, int]:
        for store in self.stores:
            if channel < len(store.channels):
                return store, channel
            channel -= len(store.channels)
        raise IndexError(channel)


@dataclass(frozen=True)
class FileState:
    """Size and time of change of a file that was opened, to notice that it changes.

    Args:
        path: the file.
        size_bytes: its size.
        changed_ns: when it was last written to.
    """

    path: Path
    size_bytes: int
    changed_ns: int

    @classmethod
    def of(cls, path: Path) -> FileState:
        """The state of a file now.

        Raises:
            RecordingError: no such file, or not readable.
        """
        try:
            status = path.stat()
        except OSError as error:
            raise RecordingError(
                error.strerror or str(error), want="a recording", path=path
            ) from error
        return cls(path, status.st_size, status.st_mtime_ns)

    def check(self) -> None:
        """Raise `RecordingError` where the file is another one now."""
        now = FileState.of(self.path)
        if now != replace(self, path=now.path):
            raise RecordingError(
                f"a file of {now.size_bytes} bytes that changed since it was opened",
                want=f"the {self.size_bytes} bytes that were there",
                fix="Wait until it is written completely.",
                path=self.path,
            )
