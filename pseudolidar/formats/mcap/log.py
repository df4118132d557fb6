"""MCAP recordings that survive a kill and end with the same bytes.

A recording is a prologue (who wrote it, with which settings and calibration), then a few chunks a
frame, then a summary. While it is written it is called `NAME.mcap.part`. Whole frames of a `.part`
are kept where they stand, the torn end is cut off, and writing goes on: frames do not depend on one
another, so the result is what an uninterrupted run writes.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator, Sequence
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.opcode import Opcode
from mcap.records import Header

from pseudolidar.errors import OutputError, RecordingError, SequenceTime
from pseudolidar.formats.atomic import drop_from_cache, fsync_folder, output_error, write_all
from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.check import McapSummary, check_mcap
from pseudolidar.formats.mcap.frame import FramePart, IndexedChunk, describe_chunk
from pseudolidar.formats.mcap.profile import Profile
from pseudolidar.formats.mcap.profiles import profile_of_header
from pseudolidar.formats.mcap.prolog import McapProlog, prolog_bytes
from pseudolidar.formats.mcap.records import (
    MAGIC,
    PackedChunk,
    RawRecord,
    parsed,
    read_record,
    unpacked,
)
from pseudolidar.formats.mcap.summary import SummaryBuilder

__all__ = ["McapLog", "McapProlog", "frames_in", "part_path", "whole_frames"]

PART_SUFFIX = ".part"

# Every byte is read back by its CRC when it was written; of so many frames the messages are read
# once more from the complete file (20 ms each where they hold a dense cloud).
CHECKED_FRAMES = 50
READ_BLOCK_BYTES = 1 << 20
BEFORE_FRAMES = (Opcode.HEADER, Opcode.METADATA, Opcode.ATTACHMENT)


class McapLog:
    """A recording that is being written: frames in order, each durable when `append` returns.

    Use it as a context manager: leaving it without an error completes the recording, leaving it
    with one keeps what was written for a later run.

    Args:
        path: final name, `NAME.mcap`.
        prolog: what the recording says about itself.
        committed: frames that a run before finished, in order; those that the file holds from
            the beginning on are kept (`held`), everything after them is cut off. None starts anew.
        check: read the completed file back and check it: every byte by CRC, the messages of some
            fifty frames spread over it.

    Raises:
        OutputError: the folder cannot be written, or a file of that name is another recording.
    """

    def __init__(
        self,
        path: Path,
        prolog: McapProlog,
        *,
        committed: Sequence[str] | None = None,
        check: bool = True,
    ) -> None:
        self.path, self.part = path, part_path(path)
        self.summary: McapSummary | None = None
        self._check = check
        self._builder = SummaryBuilder(profile_of_header(prolog.profile))
        beginning = prolog_bytes(prolog, self._builder)
        with _as_output_error(path, len(beginning)):
            path.parent.mkdir(parents=True, exist_ok=True)
            if committed is not None and path.exists() and not self.part.exists():
                _check_ours(path, beginning)
                path.replace(self.part)
            mode = "r+b" if committed is not None and self.part.exists() else "w+b"
            self._file = FileIO(self.part, mode)
        try:
            self._begin(beginning, committed or ())
        except BaseException:
            self._file.close()
            raise

    @property
    def held(self) -> tuple[str, ...]:
        """Frames of `committed` that the file still has: the run goes on after them."""
        return self._held

    def append(self, frame: FramePart, *, sync: bool = True) -> None:
        """Write a frame and make it durable.

        Args:
            frame: the next frame.
            sync: False leaves it to a later `sync` to make it survive a power cut; a kill it
                survives anyway.

        Raises:
            SequenceTime: it is earlier than the frame before.
            OutputError: disk full; the file keeps the frames before, and writing can go on.
        """
        if frame.start_ns < self._builder.end_ns:
            raise SequenceTime(
                f"time stamp {frame.start_ns} ns after {self._builder.end_ns} ns",
                want="increasing time stamps",
                where=f"frame {frame.frame_id}",
            )
        offset = self._offset
        self._write(*frame.parts, sync=sync)
        self._builder.add_frame(frame, offset)

    def sync(self) -> None:
        """Make all that was appended durable.

        Raises:
            OutputError: the disk refuses it.
        """
        with _as_output_error(self.path):
            os.fsync(self._file.fileno())

    def close(self) -> McapSummary | None:
        """Complete the recording: summary, durable, its final name, then checked.

        Raises:
            OutputError: disk full; the `.part` stays, without a summary.
            RecordingError: what was written does not read back as it should.
        """
        self._write(self._builder.ending(self._offset, self._crc))
        self._file.close()
        with _as_output_error(self.path):
            self.part.replace(self.path)
            fsync_folder(self.path.parent)
        if self._check:
            every = 1 + self._builder.frames // CHECKED_FRAMES
            self.summary = check_mcap(self.path, every=every)
        return self.summary

    def abandon(self) -> None:
        """Stop without completing; the `.part` stays for a later run."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self.close()
        finally:
            self.abandon()

    def _begin(self, beginning: bytes, committed: Sequence[str]) -> None:
        """Keep the whole frames of an earlier run, or write the prologue."""
        self._offset, self._crc = 0, 0
        held = []
        if self._file.read(len(beginning)) == beginning:
            self._offset, self._crc = len(beginning), crc32(beginning)
            wanted = iter(committed)
            for offset, frame in whole_frames(self._file, self._offset, self._builder.profile):
                if frame.frame_id != next(wanted, None):
                    break
                self._builder.add_frame(frame, offset)
                self._advance(*frame.parts)
                held.append(frame.frame_id)
        self._held = tuple(held)
        with _as_output_error(self.path):
            self._file.truncate(self._offset)
        if self._offset == 0:
            self._write(beginning)
            fsync_folder(self.path.parent)

    def _write(self, *parts: bytes | memoryview, sync: bool = True) -> None:
        """Append; after a failure the file is as before."""
        try:
            self._file.seek(self._offset)
            for part in parts:
                write_all(self._file, part)
            if sync:
                os.fsync(self._file.fileno())
                self._read_back(parts)
                drop_from_cache(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._offset)
            raise output_error(self.path, error, sum(map(len, parts))) from error
        self._advance(*parts)

    def _read_back(self, parts: Sequence[bytes | memoryview]) -> None:
        """Raise `OSError` unless the file holds what was written: by the CRC of every byte."""
        expected, found = 0, 0
        for part in parts:
            expected = crc32(part, expected)
        left = sum(map(len, parts))
        block = memoryview(bytearray(READ_BLOCK_BYTES))
        self._file.seek(self._offset)
        while left and (count := self._file.readinto(block[: min(left, len(block))])):
            found, left = crc32(block[:count], found), left - count
        if left or found != expected:
            raise OSError(errno.EIO, "what was written does not read back")

    def _advance(self, *parts: bytes | memoryview) -> None:
        for part in parts:
            self._crc = crc32(part, self._crc)
            self._offset += len(part)


def _check_ours(path: Path, beginning: bytes) -> None:
    """Raise `OutputError` where a complete file is not what would be continued, but another's."""
    with FileIO(path, "rb") as file:
        if file.read(len(beginning)) != beginning:
            raise OutputError(
                "there is another recording of that name",
                want="a new name, or the recording of this run",
                fix="Move it away, or choose another output folder.",
                path=path,
            )


def part_path(path: Path) -> Path:
    """What a recording is called while it is written."""
    return path.with_name(path.name + PART_SUFFIX)


def frames_in(path: Path) -> tuple[str, ...]:
    """Names of the whole frames at the beginning of a recording, complete or cut anywhere.

    A file that is absent or of another kind has none.
    """
    try:
        with FileIO(path, "rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                return ()
            profile = profile_of_header(_header_profile(file))
            return tuple(frame.frame_id for _, frame in whole_frames(file, len(MAGIC), profile))
    except FileNotFoundError:
        return ()


def whole_frames(
    file: FileIO, offset: int, profile: Profile, limits: Limits = DEFAULT_LIMITS
) -> Iterator[tuple[int, FramePart]]:
    """Frames from byte `offset` on with where they begin, up to the first damaged or cut."""
    size = file.seek(0, os.SEEK_END)
    chunks: list[IndexedChunk] = []
    begin = offset
    with contextlib.suppress(RecordingError):
        while offset < size:
            record = read_record(file, offset, size, limits)
            offset = record.end
            if record.opcode == Opcode.CHUNK:
                chunk = _chunk(record, profile, limits)
                if file.read(len(chunk.index)) != chunk.index:
                    return
                begin = begin if chunks else record.offset
                chunks.append(chunk)
                offset += len(chunk.index)
                if chunk.marks is not None:
                    yield begin, FramePart(chunk.marks, tuple(chunks))
                    chunks = []
            elif chunks or record.opcode not in BEFORE_FRAMES:
                return


def _chunk(record: RawRecord, profile: Profile, limits: Limits) -> IndexedChunk:
    chunk = PackedChunk.parse(record)
    records = unpacked(chunk, record.offset, limits)
    return describe_chunk(chunk, records, profile, offset=record.offset)


def _header_profile(file: FileIO) -> str:
    """What the header after the magic says; empty where it cannot be read."""
    size = file.seek(0, os.SEEK_END)
    with contextlib.suppress(RecordingError):
        record = read_record(file, len(MAGIC), size)
        if record.opcode == Opcode.HEADER:
            return parsed(Header, record).profile
    return ""


@contextlib.contextmanager
def _as_output_error(path: Path, needed_bytes: int | None = None) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise output_error(path, error, needed_bytes) from error
