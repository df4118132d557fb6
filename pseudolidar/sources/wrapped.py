"""Through selections and changes of frames to the source that they are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pseudolidar.sources.changed import ChangedSource
from pseudolidar.sources.selection import SelectedSource
from pseudolidar.sources.source import FrameSequence


def unwrapped(source: FrameSequence[Any]) -> FrameSequence[Any]:
    """The source without selections and changes around it."""
    while isinstance(source, ChangedSource | SelectedSource):
        source = source.source
    return source


def rewrapped(
    source: FrameSequence[Any], change: Callable[[FrameSequence[Any]], FrameSequence[Any]]
) -> FrameSequence[Any]:
    """The same selections and changes around what `change` makes of the source within."""
    if isinstance(source, ChangedSource | SelectedSource):
        return replace(source, source=rewrapped(source.source, change))
    return change(source)
