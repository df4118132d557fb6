"""A video file: its frames by number, with their times."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pseudolidar.errors import VideoDamaged, VideoUnreadable
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import DecodedImage
from pseudolidar.formats.video.index import VideoIndex, opened, read_index

if TYPE_CHECKING:
    from pseudolidar.formats.video.decoder import VideoDecoder

# Frames tried for one that can be decoded, before the video is given up.
FRAMES_TRIED = 30


@dataclass(frozen=True, eq=False)
class VideoFile:
    """An indexed video; cheap to pickle, frames are decoded when they are asked for.

    Args:
        path: the file.
        index: its frames.
        timestamps_ns: when each is shown, by the clock of the file.
        size_px: (width, height) of its pictures, turned as they are shown.
        notes: what was assumed or is odd.
        stereo: how the file says that two eyes are packed ("left_right"), "" where it says nothing.
        size_bytes: of the file when it was indexed.
        rotated: whether pictures are turned as the file says.
        limits: caps.
    """

    path: Path
    index: VideoIndex
    timestamps_ns: tuple[int, ...]
    size_px: tuple[int, int]
    notes: tuple[str, ...]
    stereo: str
    size_bytes: int
    rotated: bool
    limits: Limits
    _open: _Opened = field(default_factory=lambda: _Opened(), repr=False)

    @classmethod
    def open(cls, path: Path, *, rotated: bool = True, limits: Limits = DEFAULT_LIMITS) -> Self:
        """Index a video and decode its first frame.

        Args:
            path: MP4, MOV, MKV, WebM, AVI, TS; any codec that PyAV decodes.
            rotated: turn pictures as the file says that they are to be shown.
            limits: caps.

        Raises:
            VideoUnreadable: no video, its directory is lost, or no frame of it can be decoded.
            LimitError: it claims too many pixels.
        """
        index = read_index(path, limits=limits)
        with opened(path) as (_, stream):
            notes = _notes(stream, index)
            stereo = stream.metadata.get("stereo_mode", "").lower()
        file = cls(
            path=path,
            index=index,
            timestamps_ns=index.timestamps_ns(),
            size_px=index.size_px,
            notes=notes,
            stereo=stereo,
            size_bytes=path.stat().st_size,
            rotated=rotated,
            limits=limits,
        )
        return file._with_size()

    def __len__(self) -> int:
        return len(self.index)

    def picture(self, number: int) -> DecodedImage:
        """Frame `number` in order of presentation; pure, callable from any thread.

        Raises:
            VideoDamaged: it cannot be decoded whole.
            VideoUnreadable: the file is gone or has changed.
        """
        from pseudolidar.formats.video.pixels import to_pixels

        return to_pixels(self._open.decoder(self).frame(number), rotated=self.rotated)

    @property
    def packets_decoded(self) -> int:
        """Packets decoded in this process so far: what random access costs."""
        return self._open.decoder(self).packets_decoded

    def _with_size(self) -> Self:
        """With the size of a decoded picture, which is what counts."""
        fault: VideoDamaged | None = None
        for number in range(min(FRAMES_TRIED, len(self))):
            try:
                shape = self.picture(number).pixels.shape
            except VideoDamaged as error:
                fault = error
                continue
            return replace(self, size_px=(shape[1], shape[0]))
        assert fault is not None
        raise VideoUnreadable(
            f"none of the first {min(FRAMES_TRIED, len(self))} frames can be decoded: {fault.got}",
            want="a video that can be decoded",
            path=self.path,
        )


class _Opened:
    """The decoder of a file in this process; it does not travel to another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._decoder: VideoDecoder | None = None

    def __reduce__(self) -> tuple[type[_Opened], tuple[()]]:
        return _Opened, ()

    def decoder(self, file: VideoFile) -> VideoDecoder:
        """The file's decoder, opened when it is first asked for."""
        from pseudolidar.formats.video.decoder import VideoDecoder, check_unchanged

        with self._lock:
            if self._decoder is None:
                check_unchanged(file.path, file.size_bytes)
                self._decoder = VideoDecoder(file.path, file.index, file.limits)
            return self._decoder


def _notes(stream: Any, index: VideoIndex) -> tuple[str, ...]:
    """What was assumed about a stream, and what is odd about it."""
    from pseudolidar.formats.video.pixels import colour_note

    aspect = stream.sample_aspect_ratio or Fraction(1)
    lost = max(0, index.promised - index.packets)
    found = {
        colour_note(stream.codec_context): True,
        f"pixels are {aspect} times as wide as high: kept as stored, and the rig has to be of the "
        "stored picture": aspect != 1,
        f"the file ends early: {index.cut}": bool(index.cut),
        f"the file ends early: {lost} of {index.promised} frames are not in it": lost > 0,
        f"{index.repeated} frames with the time of another one left out": index.repeated > 0,
        f"{index.leading} frames at the start left out: what they need is cut off": index.leading
        > 0,
    }
    return tuple(note for note, holds in found.items() if note and holds)
