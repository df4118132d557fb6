"""Caps on untrusted input, checked before anything is allocated."""

from __future__ import annotations

from dataclasses import dataclass

# A chunk this small may unpack to more than `Limits.chunk_expansion` times its size.
ALWAYS_UNPACKED_BYTES = 2**20


@dataclass(frozen=True)
class Limits:
    """The largest input that is believed; raise a cap where a file is really that large.

    Args:
        pixels: pixels of one image.
        text_bytes: size of a calibration, label or pose file.
        text_lines: its lines.
        points: points of one cloud.
        record_bytes: one record of a recording.
        chunk_bytes: one unpacked chunk of a recording.
        chunk_expansion: how many times larger than packed it may be.
        chunk_records: records of one unpacked chunk.
    """

    pixels: int = 100_000_000
    text_bytes: int = 10_000_000
    text_lines: int = 300_000
    points: int = 200_000_000
    record_bytes: int = 256 * 2**20
    chunk_bytes: int = 2**30
    chunk_expansion: int = 1000
    chunk_records: int = 4_000_000

    def allowed_unpacked(self, packed_bytes: int) -> int:
        """Bytes that a chunk of so many may unpack to."""
        allowed = max(ALWAYS_UNPACKED_BYTES, packed_bytes * self.chunk_expansion)
        return min(self.chunk_bytes, allowed)


DEFAULT_LIMITS = Limits()


def raise_cap(name: str) -> str:
    """What to do where a file really is larger than the cap of that name."""
    return f"If it really is that large, raise the cap: --source.limits.{name.replace('_', '-')}."
