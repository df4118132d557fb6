"""A frame's part of the recording, with its obstacles as they are told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.running.products.converted import Converted
from pseudolidar.running.products.encoders import packed
from pseudolidar.running.products.found import Found
from pseudolidar.running.products.told import ToldFrame

if TYPE_CHECKING:
    from pseudolidar.formats.mcap.frame import FramePart


def found_parts(found: Found, content: McapContent) -> dict[str, FramePart]:
    """What is large of a frame, by the ending of the file's name; for workers."""
    seen = found.seen
    converted = Converted(found.frame, found.cloud, seen.disparity, seen.sight.depth)
    return packed(converted, content)


def told_parts(
    parts: Mapping[str, FramePart], told: ToldFrame, *, index: int, content: McapContent
) -> dict[str, FramePart]:
    """The same with the frame's obstacles and their tracks, in the order of the frames.

    Args:
        parts: as a worker packed them; none without a recording.
        told: of the frame.
        index: position of the frame in the source.
        content: what the recording holds.
    """
    if not parts:
        return {}
    from pseudolidar.formats.mcap.frame import with_more
    from pseudolidar.formats.mcap.messages import obstacle_messages
    from pseudolidar.formats.mcap.split import split_messages

    messages = obstacle_messages(told.obstacles, timestamp_ns=told.time_ns, content=content)
    by_file = split_messages(messages, content.split)
    return {
        ending: with_more(part, by_file[ending], index=index, compression=content.compression)
        for ending, part in parts.items()
    }
