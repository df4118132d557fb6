"""Whole pictures of packets as they come, of a video that goes on while it is read.

Nothing can be looked at twice and nothing is known of what follows: a picture that is damaged, or
predicted from a damaged one, is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.video.cursor import HARMLESS

if TYPE_CHECKING:
    from av import Packet, VideoFrame

_JPEG, _END_OF_JPEG = "mjpeg", b"\xff\xd9"
# Cameras fill the transfer buffer behind a JPEG with zeros, or leave the end of an older picture
# there: only zeros are passed over.
_FILLING = b"\x00"


class WholeFrames:
    """Decodes the packets of one track in order.

    Args:
        track: of an open container.
        damaged: told the reason for each packet that gives no whole picture.
        limits: cap on the pixels that the stream may claim.
    """

    def __init__(
        self, track: Any, damaged: Callable[[str], None], limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self._track, self._damaged, self._limits = track, damaged, limits
        self._context = track.codec_context
        self._alone = bool(self._context.codec.intra_only)  # no picture needs another one
        self._needs_key, self._begun = not self._alone, False
        self._trusted_from: int | None = None  # time of the last key frame waited for, ticks
        self._set_up()

    def decode(self, packet: Packet) -> list[VideoFrame]:
        """The whole pictures that a packet completes; of an empty packet those still held back."""
        if packet.size and self._needs_key:
            if not packet.is_keyframe:
                if self._begun:  # nobody misses what came before the first whole picture
                    self._damaged("predicted from a damaged picture")
                return []
            self._needs_key, self._trusted_from = False, packet.pts
        frames, reason = self._tried(packet)
        if reason:
            self._damaged(reason)
            if not self._alone:
                self._renew()
            return []
        self._begun = self._begun or bool(frames)
        return [frame for frame in frames if self._is_trusted(frame)]

    def _tried(self, packet: Packet) -> tuple[list[VideoFrame], str]:
        """What the decoder gives, and why it cannot be trusted."""
        import av

        frames: list[VideoFrame] = []
        reason = _cut(packet, self._context.codec.name)
        with av.logging.Capture() as complaints:
            try:
                frames = self._context.decode(packet)
            except av.error.FFmpegError as error:
                reason = reason or error.strerror or str(error)
        said = (
            text.strip()
            for level, _, text in complaints
            if level <= av.logging.ERROR and not text.startswith(HARMLESS)
        )
        marked = "the decoder marks it as corrupt" if any(f.is_corrupt for f in frames) else ""
        return frames, reason or next(said, "") or marked

    def _is_trusted(self, frame: VideoFrame) -> bool:
        """Whether a picture comes no earlier than the key frame: else it needs what is lost."""
        if self._trusted_from is None or frame.pts is None:
            return True
        return bool(frame.pts >= self._trusted_from)

    def _renew(self) -> None:
        """Another decoder from the next key frame on: damage can outlive that in the old one."""
        import av

        old = self._context
        self._context = av.CodecContext.create(old.codec.name, "r")
        self._context.extradata = self._track.codec_context.extradata
        self._context.width, self._context.height = old.width, old.height
        if old.pix_fmt is not None:
            self._context.pix_fmt = old.pix_fmt
        self._needs_key = True
        self._set_up()

    def _set_up(self) -> None:
        # One thread: a picture is there with its own packet, and so is a complaint about it.
        self._context.thread_type, self._context.thread_count = "NONE", 1
        self._context.options = {
            "err_detect": "crccheck+bitstream+buffer",
            "max_pixels": str(self._limits.pixels),
        }


def _cut(packet: Packet, codec: str) -> str:
    """Why a packet is not whole by itself, "" if it seems to be."""
    if not packet.size:
        return ""
    if packet.is_corrupt:
        return "a damaged packet"
    if codec == _JPEG and not bytes(packet).rstrip(_FILLING).endswith(_END_OF_JPEG):
        return "a picture that ends early"
    return ""
