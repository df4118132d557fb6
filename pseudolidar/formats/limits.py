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
    """

    pixels: int = 100_000_000
    text_bytes: int = 10_000_000
    points: int = 200_000_000
    record_bytes: int = 256 * 2**20


DEFAULT_LIMITS = Limits()
