"""Overlapping stretches of a length, such as tiles along a picture's edge."""

from __future__ import annotations

from collections.abc import Iterator


def spans(length: int, tile: int, overlap: int) -> Iterator[tuple[int, int]]:
    """Starts and ends that cover a length with equal tiles; the last one ends at its end."""
    if tile >= length:
        yield 0, length
        return
    step = max(1, tile - overlap)
    starts = range(0, length - tile + step, step)
    for start in starts:
        end = min(start + tile, length)
        yield end - tile, end
        if end == length:
            return
