"""Where a camera is: a device, a pipe, a network address, or a video that is played as one."""

from __future__ import annotations

import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from pseudolidar.errors import CameraUnavailable, UsageError

CameraKind = Literal["device", "pipe", "stream", "file"]
DEVICES = Path("/dev")
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
# A network address must not make libav read local files or start anything.
NETWORK = ("rtsp", "rtsps", "rtmp", "http", "https", "tcp", "udp", "rtp", "srt")


@dataclass(frozen=True)
class CameraAddress:
    """Where pictures come from.

    Args:
        kind: what is there.
        place: path or network address, as libav takes it.
    """

    kind: CameraKind
    place: str

    @classmethod
    def of(cls, text: str, *, realtime: bool = False) -> Self:
        """What `text` means: `0` is /dev/video0; else a path or rtsp://, http://, tcp://, udp://.

        Args:
            text: as a user gives it.
            realtime: videos are to be played as if live.

        Raises:
            CameraUnavailable: nothing is there; says which cameras there are.
            UsageError: a video that is not to be played, or an address of another kind.
        """
        if _URL.match(text):
            return cls("stream", _network(text))
        place = DEVICES / f"video{text}" if text.isascii() and text.isdigit() else Path(text)
        try:
            mode = place.stat().st_mode
        except (OSError, ValueError) as error:
            raise _absent(place) from error
        if stat.S_ISCHR(mode):
            return cls("device", str(place))
        if stat.S_ISFIFO(mode):
            return cls("pipe", str(place))
        if not stat.S_ISREG(mode):
            raise UsageError(
                "neither a camera nor a video", want="a camera: 0, /dev/video0", path=place
            )
        if not realtime:
            raise UsageError(
                "a file, not a camera",
                want="a camera: 0, /dev/video0",
                fix="Add --realtime to play it as if live, or convert all of it with `convert`.",
                path=place,
            )
        return cls("file", str(place))

    @property
    def reopens(self) -> bool:
        """Whether it makes sense to try again when it ends: cameras come back, files do not."""
        return self.kind != "file"


def cameras_present() -> tuple[str, ...]:
    """Video devices of this machine."""
    found = (path for path in DEVICES.glob("video*") if path.name[5:].isdigit())
    return tuple(str(path) for path in sorted(found, key=lambda path: int(path.name[5:])))


def _network(text: str) -> str:
    scheme = text.partition(":")[0].lower()
    if scheme not in NETWORK:
        raise UsageError(
            f"an address that begins with {scheme}://", want=", ".join(f"{n}://" for n in NETWORK)
        )
    return text


def _absent(place: Path) -> CameraUnavailable:
    present = cameras_present()
    what = f"there are {', '.join(present)}" if present else "this machine has no camera"
    return CameraUnavailable(
        f"no such camera or file; {what}",
        want="a camera: 0, /dev/video0, or a video with --realtime",
        path=place,
    )
