"""Caps on untrusted input, checked before anything is allocated."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """The largest input that is believed; raise a cap where a file is really that large.

    Args:
        pixels: pixels of one image.
        text_bytes: size of a calibration, label or pose file.
        points: points of one cloud.
        record_bytes: one record of a recording.
        chunk_bytes: one unpacked chunk of a recording.
        chunk_expansion: how many times larger than packed it may be.
    """

    pixels: int = 100_000_000
    text_bytes: int = 10_000_000
    points: int = 200_000_000
    record_bytes: int = 256 * 2**20
    chunk_bytes: int = 2**30
    chunk_expansion: int = 1000


DEFAULT_LIMITS = Limits()
