"""A recording, whatever it is, opened as a store of messages."""

from __future__ import annotations

from pathlib import Path

from pseudolidar.errors import RecordingError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.mcap.reader import open_mcap
from pseudolidar.formats.recordings.kinds import BAG1, BAG2, DB3, MCAP, recording_kind
from pseudolidar.formats.recordings.message_store import JoinedStore, MessageStore
from pseudolidar.formats.ros.rosbag1 import open_bag
from pseudolidar.formats.ros.rosbag2 import bag_files, open_db3


def open_store(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> MessageStore:
    """Open a recording; its messages are listed, not read.

    Raises:
        RecordingError: none that is known, or nothing of it can be read.
    """
    kind = recording_kind(path)
    if kind == MCAP:
        return open_mcap(path, limits=limits)
    if kind == DB3:
        return open_db3(path, limits=limits)
    if kind == BAG1:
        return open_bag(path, limits=limits)
    if kind == BAG2:
        files, packed = bag_files(path, limits=limits)
        return JoinedStore(tuple(_open_part(file, packed, limits) for file in files))
    raise RecordingError("no recording", want="an MCAP, a ROS 2 bag or a ROS 1 bag", path=path)


def _open_part(file: Path, packed: bool, limits: Limits) -> MessageStore:
    if recording_kind(file) == MCAP:
        return open_mcap(file, limits=limits)
    return open_db3(file, packed=packed, limits=limits)
