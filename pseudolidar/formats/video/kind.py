"""Whether a file is a video, by its first bytes; light to import."""

from __future__ import annotations

from pathlib import Path

# Extensions of videos, for files in a folder; a file that is named itself is known by its content.
EXTENSIONS = frozenset(
    {".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".ts", ".mts", ".m2ts", ".mpg", ".mpeg"}
)
_ISO_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot")
_MATROSKA = b"\x1aE\xdf\xa3"
_MPEG_PROGRAM = b"\x00\x00\x01\xba"
# A transport stream: this byte at the start of every packet, of 188 or (with a time) 192 bytes.
_SYNC, _TRANSPORT_PACKETS, _PACKETS_SEEN = 0x47, ((0, 188), (4, 192)), 4
_HEAD_BYTES = 1024


def video_kind(path: Path) -> str | None:
    """Kind of container that `path` begins like, None where it is no video."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return None
    if head[4:8] in _ISO_BOXES:
        return "MP4"
    if head.startswith(_MATROSKA):
        return "Matroska"
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return "AVI"
    if head.startswith(_MPEG_PROGRAM):
        return "MPEG"
    for start, step in _TRANSPORT_PACKETS:
        syncs = head[start : start + step * _PACKETS_SEEN : step]
        if len(syncs) == _PACKETS_SEEN and set(syncs) == {_SYNC}:
            return "MPEG transport stream"
    return None
