"""What kind of recording a path is, by its content; light to import."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

MCAP, DB3, BAG1, BAG2 = "MCAP", "ROS 2 bag (SQLite)", "ROS 1 bag", "ROS 2 bag"
MAGICS: Final[Mapping[bytes, str]] = {
    b"\x89MCAP0\r\n": MCAP,
    b"SQLite format 3\0": DB3,
    b"#ROSBAG V2.0\n": BAG1,
}
# A folder is a ROS 2 bag by this file, which begins so.
METADATA_FILE = "metadata.yaml"
METADATA_TITLE = b"rosbag2_bagfile_information:"
SNIFFED_BYTES = 4096
SUFFIXES = (".mcap", ".db3", ".bag")


def recording_kind(path: Path) -> str:
    """What kind of recording a file or folder is; "" for none."""
    if path.is_dir():
        return BAG2 if METADATA_TITLE in _start(path / METADATA_FILE) else ""
    start = _start(path)
    return next((kind for magic, kind in MAGICS.items() if start.startswith(magic)), "")


def recordings_in(folder: Path) -> list[Path]:
    """Files of recordings that lie in a folder, by name; none of what is no folder."""
    if not folder.is_dir():
        return []
    files = sorted(entry for entry in folder.iterdir() if entry.suffix in SUFFIXES)
    return [file for file in files if file.is_file() and recording_kind(file)]


def _start(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(SNIFFED_BYTES)
    except OSError:
        return b""
