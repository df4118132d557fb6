"""The end of an MCAP file: indexes, counts and check sums of all that was appended."""

from __future__ import annotations

import struct
from collections import Counter

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    ChunkIndex,
    DataEnd,
    Footer,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)

from pseudolidar.formats.checksum import crc32
from pseudolidar.formats.mcap.frame import FramePart, IndexedChunk
from pseudolidar.formats.mcap.profile import Profile
from pseudolidar.formats.mcap.records import MAGIC, record_bytes

# Footer: summary start, summary offset start, CRC of all before.
FOOTER = struct.Struct("<QQI")
# What the summary's CRC covers of the footer record: header, summary start, summary offset start.
FOOTER_START = struct.Struct("<BQQQ")


class SummaryBuilder:
    """Collects what the summary needs: some 200 bytes a chunk, and nothing of its messages.

    Args:
        profile: of the recording.
    """

    def __init__(self, profile: Profile) -> None:
        self.profile = profile
        self._chunks = bytearray()
        self._chunk_count = 0
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._frames = 0
        self._start_ns = self._end_ns = 0

    @property
    def frames(self) -> int:
        """Frames so far."""
        return self._frames

    @property
    def end_ns(self) -> int:
        """Latest time stamp so far, 0 before the first."""
        return self._end_ns

    def add_metadata(self, index: MetadataIndex) -> None:
        """A metadata record was written."""
        self._metadata.append(index)

    def add_attachment(self, index: AttachmentIndex) -> None:
        """An attachment was written."""
        self._attachments.append(index)

    def add_frame(self, frame: FramePart, offset: int) -> None:
        """A frame was written at byte `offset`."""
        for chunk in frame.chunks:
            self._add_chunk(chunk, offset)
            offset += chunk.nbytes
        self._frames += 1

    def _add_chunk(self, chunk: IndexedChunk, offset: int) -> None:
        index_start = offset + chunk.chunk_bytes
        self._chunks += record_bytes(
            ChunkIndex(
                chunk_length=chunk.chunk_bytes,
                chunk_start_offset=offset,
                compression=chunk.compression,
                compressed_size=len(chunk.packed),
                message_end_time=chunk.end_ns,
                message_index_length=len(chunk.index),
                message_index_offsets={
                    number: index_start + at for number, at in chunk.index_offsets.items()
                },
                message_start_time=chunk.start_ns,
                uncompressed_size=chunk.unpacked_bytes,
            )
        )
        self._counts.update(chunk.counts)
        self._start_ns = (
            min(self._start_ns, chunk.start_ns) if self._chunk_count else chunk.start_ns
        )
        self._end_ns = max(self._end_ns, chunk.end_ns)
        self._chunk_count += 1

    def ending(self, offset: int, data_crc: int) -> bytes:
        """All bytes after the last frame.

        Args:
            offset: byte after the last frame.
            data_crc: CRC of the file up to there.
        """
        data_end = record_bytes(DataEnd(data_crc))
        start = offset + len(data_end)
        groups = {opcode: group for opcode, group in self._groups().items() if group}
        summary = b"".join(groups.values())
        offsets_start = start + len(summary)
        summary += b"".join(_summary_offsets(groups, start))
        footer = _footer(summary, start, offsets_start)
        return data_end + summary + footer + MAGIC

    def _groups(self) -> dict[int, bytes]:
        """Records of the summary by kind, in the order of the file."""
        used = sorted(self._counts)
        profile = self.profile
        schemas = sorted({profile.schema_id(number) for number in used})
        return {
            Opcode.SCHEMA: b"".join(profile.schema_records[number] for number in schemas),
            Opcode.CHANNEL: b"".join(profile.channel_records[number] for number in used),
            Opcode.STATISTICS: record_bytes(self._statistics(len(schemas))),
            Opcode.CHUNK_INDEX: bytes(self._chunks),
            Opcode.ATTACHMENT_INDEX: b"".join(map(record_bytes, self._attachments)),
            Opcode.METADATA_INDEX: b"".join(map(record_bytes, self._metadata)),
        }

    def _statistics(self, schemas: int) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._counts),
            channel_message_counts=dict(sorted(self._counts.items())),
            chunk_count=self._chunk_count,
            message_count=self._counts.total(),
            message_end_time=self._end_ns,
            message_start_time=self._start_ns,
            metadata_count=len(self._metadata),
            schema_count=schemas,
        )


def _summary_offsets(groups: dict[int, bytes], start: int) -> list[bytes]:
    records = []
    for opcode, group in groups.items():
        record = SummaryOffset(group_opcode=opcode, group_start=start, group_length=len(group))
        records.append(record_bytes(record))
        start += len(group)
    return records


def _footer(summary: bytes, start: int, offsets_start: int) -> bytes:
    head = FOOTER_START.pack(Opcode.FOOTER, FOOTER.size, start, offsets_start)
    crc = crc32(head, crc32(summary))
    return record_bytes(
        Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=crc)
    )
