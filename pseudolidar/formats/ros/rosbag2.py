"""ROS 2 bags: a folder with `metadata.yaml` and files of SQLite (`.db3`) or MCAP, or one `.db3`."""

from __future__ import annotations

import contextlib
import re
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

from pseudolidar.errors import RecordingError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits, raise_cap
from pseudolidar.formats.recordings.kinds import METADATA_FILE
from pseudolidar.formats.recordings.message_store import Channel, FileState, Place
from pseudolidar.structures.arrays import AnyArray, Int64

STORAGE_SUFFIXES = (".db3", ".mcap")
# Of `metadata.yaml` only this is needed; paths in it are not followed.
_COMPRESSION = re.compile(rb"^\s+compression_mode:\s*[\"']?(\w+)", re.MULTILINE)
ENTRY = np.dtype([("time", "<i8"), ("row", "<i8")])
LATCHED = "durability: 1"


def bag_files(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[tuple[Path, ...], bool]:
    """The files of a bag by name, and whether each message is compressed.

    Raises:
        RecordingError: none, or files that are compressed as a whole.
    """
    with (path / METADATA_FILE).open("rb") as file:
        text = file.read(limits.text_bytes)
    match = _COMPRESSION.search(text)
    mode = match[1].decode().lower() if match else ""
    files = [file for file in path.iterdir() if file.suffix.lower() in STORAGE_SUFFIXES]
    if not files:
        packed = [file.name for file in path.iterdir() if file.suffix == ".zstd"]
        raise RecordingError(
            f"a bag whose files are packed ({packed[0]})" if packed else "a bag without files",
            want="files named .db3 or .mcap",
            fix="Unpack them: zstd -d." if packed else "",
            path=path,
        )
    return tuple(sorted(files, key=_natural)), mode == "message"


def _natural(path: Path) -> tuple[tuple[int, str], ...]:
    parts = re.split(r"([0-9]+)", path.name)
    return tuple((int(p), "") if at % 2 else (-1, p) for at, p in enumerate(parts))


def open_db3(path: Path, *, packed: bool = False, limits: Limits = DEFAULT_LIMITS) -> Db3Store:
    """Open a file of a ROS 2 bag; its messages are listed, not read.

    Args:
        path: the file.
        packed: whether each message is compressed by zstd.
        limits: caps on messages.

    Raises:
        RecordingError: no database, or not one of a bag.
    """
    state = FileState.of(path)
    with _connected(path) as database:
        rows = _rows(database, "SELECT id, name, type, serialization_format FROM topics")
        topics = {int(number): (str(n), str(t), str(f)) for number, n, t, f in rows}
        definitions, durable = _definitions(database), _durable(database)
        query = "SELECT topic_id, timestamp, id FROM messages ORDER BY timestamp, id"
        listed = np.array(list(_rows(database, query)), np.int64).reshape(-1, 3)
    channels, entries = [], []
    for number, (name, kind, encoding) in topics.items():
        own = listed[listed[:, 0] == number]
        if not len(own):
            continue
        form, text = definitions.get(kind, ("", b""))
        latched = number in durable or name == "/tf_static"
        channels.append(Channel(name, kind, text, form, encoding, latched))
        entry = np.empty(len(own), ENTRY)
        entry["time"], entry["row"] = own[:, 1], own[:, 2]
        entries.append(entry)
    return Db3Store(state, tuple(channels), tuple(entries), packed, limits)


@dataclass(frozen=True, eq=False)
class Db3Store:
    """An opened file of a ROS 2 bag; see `MessageStore`. SQLite has no check sums.

    Args:
        state: the file.
        channels: its topics that have messages.
        entries: by channel, `ENTRY` of each message, by time.
        packed: whether each message is compressed.
        limits: caps on messages.
    """

    state: FileState
    channels: tuple[Channel, ...]
    entries: tuple[AnyArray, ...] = field(repr=False)
    packed: bool
    limits: Limits
    notes: tuple[str, ...] = ()
    written_by: str = "rosbag2"

    def attachment(self, name: str) -> bytes:  # noqa: ARG002
        """None: bags carry no files."""
        return b""

    def times_ns(self, channel: int) -> Int64:
        """(N,) times of a topic."""
        return np.ascontiguousarray(self.entries[channel]["time"])

    def read(self, places: Sequence[Place]) -> list[bytes | memoryview]:
        """Messages.

        Raises:
            RecordingError: damaged, or larger than the caps.
        """
        self.state.check()
        with _connected(self.state.path) as database:
            return [
                self._message(database, int(self.entries[channel][number]["row"]))
                for channel, number in places
            ]

    def heads(self, channel: int, size: int) -> Iterator[bytes | memoryview]:
        """First bytes of each message of a topic."""
        with _connected(self.state.path) as database:
            for row in self.entries[channel]["row"]:
                if self.packed:
                    yield self._message(database, int(row))[:size]
                else:
                    query = "SELECT substr(data, 1, ?) FROM messages WHERE id = ?"
                    (found,) = _rows(database, query, (size, int(row)))
                    yield bytes(found[0])

    def _message(self, database: sqlite3.Connection, row: int) -> bytes:
        ((size,),) = _rows(database, "SELECT length(data) FROM messages WHERE id = ?", (row,))
        self._check_size(int(size), row)
        ((data,),) = _rows(database, "SELECT data FROM messages WHERE id = ?", (row,))
        if not self.packed:
            return bytes(data)
        try:
            claimed = zstandard.frame_content_size(data)
            self._check_size(claimed, row)
            return zstandard.ZstdDecompressor().decompress(data, max(claimed, 0))
        except zstandard.ZstdError as error:
            raise RecordingError(
                f"a message that cannot be unpacked ({error})",
                want="an undamaged bag",
                path=self.state.path,
                where=f"message {row}",
            ) from error

    def _check_size(self, size: int, row: int) -> None:
        if size > self.limits.record_bytes:
            raise RecordingError(
                f"a message of {size} bytes",
                want=f"at most {self.limits.record_bytes}",
                fix=raise_cap("record_bytes"),
                path=self.state.path,
                where=f"message {row}",
            )


def _definitions(database: sqlite3.Connection) -> dict[str, tuple[str, bytes]]:
    """Encoding and text of the definition of each type; older bags have none."""
    query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
    try:
        rows = list(database.execute(query))
    except sqlite3.Error:
        return {}
    return {str(kind): (str(form), str(text).encode()) for kind, form, text in rows}


def _durable(database: sqlite3.Connection) -> set[int]:
    """Topics whose publishers keep the last message for late subscribers."""
    try:
        rows = list(database.execute("SELECT id, offered_qos_profiles FROM topics"))
    except sqlite3.Error:
        return set()
    return {int(number) for number, profiles in rows if LATCHED in str(profiles)}


def _rows(
    database: sqlite3.Connection, query: str, values: tuple[int, ...] = ()
) -> Iterator[tuple[Any, ...]]:
    yield from database.execute(query, values)


@contextlib.contextmanager
def _connected(path: Path) -> Iterator[sqlite3.Connection]:
    """The database, never written to; SQLite's errors as those of a recording."""
    try:
        database = _first_that_works(
            lambda: _open(f"{path.resolve().as_uri()}?mode=ro"),
            lambda: _open(f"{path.resolve().as_uri()}?mode=ro&immutable=1"),
        )
        try:
            yield database
        finally:
            database.close()
    except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
        raise RecordingError(
            f"a database that cannot be read ({error})",
            want="a ROS 2 bag (.db3) that was closed",
            fix="Copy it again, or mend it: sqlite3 broken.db3 .recover | sqlite3 mended.db3",
            path=path,
        ) from error


def _open(address: str) -> sqlite3.Connection:
    database = sqlite3.connect(address, uri=True)
    try:
        database.execute("PRAGMA trusted_schema = OFF")
        # Tables and nothing else: a view can compute for ever.
        query = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN (?, ?)"
        if database.execute(query, ("topics", "messages")).fetchone() != (2,):
            raise sqlite3.DatabaseError("no tables topics and messages")
    except sqlite3.Error:
        database.close()
        raise
    return database


def _first_that_works(*ways: Callable[[], sqlite3.Connection]) -> sqlite3.Connection:
    for way in ways[:-1]:
        with contextlib.suppress(sqlite3.OperationalError):
            return way()
    return ways[-1]()
