"""Any frame of a video, exactly as decoding from the start would give it, from any thread.

A decoder can only go forward from a key frame. A few of them stand at different places of the file;
whoever asks for a frame takes the one that is nearest before it, and what is decoded on the way is
kept for the others that ask for it soon. So frames that are asked for in order, by one thread or by
several, are decoded once each.
"""

from __future__ import annotations

import copy
import threading
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING

from pseudolidar.errors import VideoDamaged, VideoUnreadable
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.video.cursor import PASSED_KEPT, SEEK_PACKETS, VideoCursor
from pseudolidar.formats.video.index import VideoIndex

if TYPE_CHECKING:
    from av import VideoFrame

# Decoders of one file, each with the memory of a handful of frames.
MAX_CURSORS = 2
# Frames kept after they were decoded, for threads that ask a little later: as many as the memory
# allows, but never fewer than the least.
MOST_KEPT, LEAST_KEPT, KEPT_BYTES = 16, PASSED_KEPT, 128 * 2**20


class VideoDecoder:
    """Decodes frames of one file by number; thread-safe.

    Args:
        path: the file.
        index: its frames.
        limits: cap on the pixels that its stream may claim.
    """

    def __init__(self, path: Path, index: VideoIndex, limits: Limits) -> None:
        self._path, self._index, self._limits = path, index, limits
        self._lock = threading.Lock()
        self._cursors: list[VideoCursor] = []
        self._kept: OrderedDict[int, VideoFrame | VideoDamaged] = OrderedDict()
        frame_bytes = 3 * index.size_px[0] * index.size_px[1]
        self._most_kept = min(MOST_KEPT, max(LEAST_KEPT, KEPT_BYTES // max(frame_bytes, 1)))

    @property
    def packets_decoded(self) -> int:
        """Packets that all cursors together have decoded."""
        return sum(cursor.packets_decoded for cursor in self._cursors)

    def frame(self, number: int) -> VideoFrame:
        """Frame `number`, counted in order of presentation.

        Raises:
            VideoDamaged: it, or one that it is predicted from, cannot be decoded whole.
        """
        found = self._kept_frame(number)
        if found is None:
            with self._lock:
                cursor = self._chosen(number)
                cursor.aim = number
            with cursor.lock:
                # Another thread may have decoded it while this one waited.
                found = self._kept_frame(number) or self._decoded(cursor, number)
        if isinstance(found, VideoDamaged):
            raise copy.copy(found)
        return found

    def _decoded(self, cursor: VideoCursor, number: int) -> VideoFrame | VideoDamaged:
        def keep(passed: int, verdict: VideoFrame | VideoDamaged) -> None:
            with self._lock:
                self._kept[passed] = verdict
                while len(self._kept) > self._most_kept:
                    self._kept.popitem(last=False)

        return cursor.bring(number, keep)

    def _kept_frame(self, number: int) -> VideoFrame | VideoDamaged | None:
        with self._lock:
            if number in self._kept:
                self._kept.move_to_end(number)
            return self._kept.get(number)

    def _chosen(self, number: int) -> VideoCursor:
        """The cursor that reaches the frame with the least decoding; called under the lock."""
        ranked = sorted(self._cursors, key=lambda cursor: cursor.distance(number))
        if ranked and ranked[0].distance(number) <= self._index.steps_to(number) + SEEK_PACKETS:
            return self._latest(ranked[0])
        free = [cursor for cursor in self._cursors if not cursor.lock.locked()]
        if len(self._cursors) < MAX_CURSORS:
            cursor = VideoCursor(self._path, self._index, self._limits)
            self._cursors.append(cursor)
            return cursor
        return self._latest((free or self._cursors)[0])

    def _latest(self, cursor: VideoCursor) -> VideoCursor:
        """The cursor, as the one used last."""
        self._cursors.remove(cursor)
        self._cursors.append(cursor)
        return cursor


def check_unchanged(path: Path, size_bytes: int) -> None:
    """Raise `VideoUnreadable` where a file has another size than when it was indexed."""
    try:
        now = path.stat().st_size
    except OSError as error:
        raise VideoUnreadable(error.strerror or str(error), want="a video", path=path) from error
    if now != size_bytes:
        raise VideoUnreadable(
            f"{now} bytes, it had {size_bytes} when it was opened",
            want="a file that does not change while it is read",
            fix="Wait until the recording is complete.",
            path=path,
        )
