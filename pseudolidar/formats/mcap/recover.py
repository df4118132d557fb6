"""A complete recording of what can be saved of a damaged one."""

from __future__ import annotations

from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from pseudolidar.errors import RecordingError
from pseudolidar.formats.atomic import atomic_file
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.findings import Findings
from pseudolidar.formats.mcap.frame import CHUNK_BYTES
from pseudolidar.formats.mcap.salvage import Salvage
from pseudolidar.formats.mcap.saved import Declared, SavedMessage

COMPRESSIONS = {
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
    "none": CompressionType.NONE,
}
LIBRARY = "pseudolidar recover"
# Told how far a pass has come: bytes of the file.
Progress = Callable[[int], None]


def inspect_recording(
    path: Path,
    *,
    keep_damaged: bool = False,
    limits: Limits = DEFAULT_LIMITS,
    progress: Progress = lambda _: None,
) -> tuple[Findings, Declared, str]:
    """Read a recording that may be damaged anywhere, and tell what can be saved.

    Args:
        path: the recording; not changed.
        keep_damaged: see `Salvage`.
        limits: caps on what it may claim.
        progress: told how far it has come.

    Returns:
        What was found, the channels of the whole file, and its compression.

    Raises:
        RecordingError: it cannot be read.
    """
    findings = Findings()
    with _opened(path) as file:
        salvage = Salvage(file, keep_damaged=keep_damaged, limits=limits)
        for saved in salvage.run():
            findings.note(saved)
            progress(salvage.position)
    findings.settle(salvage.claimed)
    return findings, salvage.declared, salvage.compression or "none"


def recover_recording(
    path: Path,
    out: Path,
    *,
    known: Declared,
    compression: str,
    keep_damaged: bool = False,
    limits: Limits = DEFAULT_LIMITS,
    progress: Progress = lambda _: None,
) -> Findings:
    """Write all that can be saved as a complete recording, and read it back.

    Chunks of the new file have 4 MB; profile, schemas, channels, times, sequence numbers, metadata
    and attachments are those of the old one. Memory does not grow with the file.

    Args:
        path: the damaged recording; not changed.
        out: the new one; has its name when it is complete and was read back.
        known: channels of the whole file, of `inspect_recording`.
        compression: of the new chunks: lz4, zstd or none.
        keep_damaged: see `Salvage`.
        limits: caps on what it may claim.
        progress: told how far it has come.

    Raises:
        RecordingError: what was written does not read back as it was saved.
        OutputError: the disk is full, or the folder cannot be written.
    """
    findings = Findings()
    with _opened(path) as file, atomic_file(out) as target:
        salvage = Salvage(file, known=known, keep_damaged=keep_damaged, limits=limits)
        copy = _Copy(target, compression, known)
        for saved in salvage.run():
            copy.add(saved)
            findings.note(saved)
            progress(salvage.position)
        copy.finish()
        target.flush()
        findings.settle(salvage.claimed)
        try:
            found = read_back(Path(target.name))
        except (McapError, OSError, ValueError) as error:
            text = f"what was written does not read back: {type(error).__name__} {error}"
            raise RecordingError(text, want="what was saved", path=out) from error
        if found.kept != findings.kept:
            raise RecordingError(
                f"what was written reads back as {found.saved.total()} messages",
                want=f"the {findings.saved.total()} that were saved, byte for byte",
                path=out,
            )
    return findings


def read_back(path: Path) -> Findings:
    """Every message of a complete recording, by the reader of the library `mcap`, CRCs checked.

    Raises:
        McapError: it is broken.
    """
    findings = Findings()
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True).records:
            match record:
                case Channel():
                    channels[record.id] = record
                case Attachment():
                    findings.attachments += 1
                case Metadata():
                    findings.metadata += 1
                case Message():
                    findings.add_message(
                        channels[record.channel_id].topic,
                        record.sequence,
                        record.log_time,
                        record.publish_time,
                        memoryview(record.data),
                    )
        file.seek(0)
        summary = make_reader(file).get_summary()
    counted = None if summary is None else summary.statistics
    if counted is None or counted.message_count != findings.saved.total():
        raise ValueError("its index counts other messages than there are")
    return findings


def _opened(path: Path) -> FileIO:
    try:
        return FileIO(path, "rb")
    except FileNotFoundError:
        raise RecordingError("no such file", want="an MCAP recording", path=path) from None
    except OSError as error:
        raise RecordingError(error.strerror or str(error), want="a file", path=path) from error


class _Copy:
    """The new recording while it is written."""

    def __init__(self, target: BinaryIO, compression: str, known: Declared) -> None:
        self._writer = Writer(
            target,
            chunk_size=CHUNK_BYTES,
            compression=COMPRESSIONS[compression],
            enable_data_crcs=True,
        )
        self._known = known
        self._started = False
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[tuple[str, str, int, tuple[tuple[str, str], ...]], int] = {}

    def add(self, saved: object) -> None:
        """One thing that was saved."""
        match saved:
            case Header():
                self._start(saved)
            case SavedMessage():
                self._start(None)
                self._writer.add_message(
                    self._channel(saved.channel, saved.schema),
                    log_time=saved.log_time_ns,
                    publish_time=saved.publish_time_ns,
                    sequence=saved.sequence,
                    data=bytes(saved.data),
                )
            case Attachment():
                self._start(None)
                self._writer.add_attachment(
                    create_time=saved.create_time,
                    log_time=saved.log_time,
                    name=saved.name,
                    media_type=saved.media_type,
                    data=saved.data,
                )
            case Metadata():
                self._start(None)
                self._writer.add_metadata(saved.name, saved.metadata)

    def finish(self) -> None:
        """Index and end."""
        self._start(None)
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _start(self, header: Header | None) -> None:
        """The new header; where that of the old file is lost, messages tell the profile."""
        if self._started:
            return
        self._started = True
        if header is not None:
            library = f"{header.library}; {LIBRARY}" if header.library else LIBRARY
            self._writer.start(header.profile, library)
            return
        encodings = {channel.message_encoding for channel in self._known.channels.values()}
        self._writer.start("ros2" if encodings == {"cdr"} else "", LIBRARY)

    def _channel(self, channel: Channel, schema: Schema | None) -> int:
        schema_id = 0 if schema is None else self._schema(schema)
        metadata = tuple(sorted(channel.metadata.items()))
        key = channel.topic, channel.message_encoding, schema_id, metadata
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, dict(channel.metadata)
            )
        return self._channels[key]

    def _schema(self, schema: Schema) -> int:
        key = schema.name, schema.encoding, schema.data
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(*key)
        return self._schemas[key]
