"""Pictures and clouds of a frame in recordings of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pseudolidar.formats.mcap.content import Split
from pseudolidar.formats.mcap.items import Kind

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.messages import LogMessage

# What has points or boxes in space; marks, log, transforms and poses are in every file.
CLOUDS = frozenset(
    {
        Kind.STEREO_POINTS,
        Kind.STEREO_POINTS_DRACO,
        Kind.POINTS,
        Kind.POINTS_DRACO,
        Kind.SCAN,
        Kind.LABELS,
        Kind.OBSTACLES,
        Kind.OBSTACLE_EDGES,
        Kind.MAP_POINTS,
    }
)
EVERYWHERE = frozenset({Kind.MARK, Kind.NOTE, Kind.TRANSFORMS, Kind.POSE, Kind.PATH})
# The one file of a recording that is not split has no ending to its name.
WHOLE = ""


def split_endings(split: Split) -> tuple[str, ...]:
    """What the names of the files end with."""
    return (WHOLE,) if split == "none" else tuple(split.split(","))


def split_messages(
    messages: Sequence[LogMessage], split: Split
) -> dict[str, tuple[LogMessage, ...]]:
    """The messages of a frame by file; each file is complete in itself, with its transforms."""
    if split == "none":
        return {WHOLE: tuple(messages)}

    def wanted(message: LogMessage, ending: str) -> bool:
        kind = message.profile.topic(message.channel).kind
        return kind in EVERYWHERE or (kind in CLOUDS) == (ending == "clouds")

    return {
        ending: tuple(message for message in messages if wanted(message, ending))
        for ending in split_endings(split)
    }
