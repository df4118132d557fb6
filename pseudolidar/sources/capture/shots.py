"""Pictures of cameras as they arrive, and pairs of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from pseudolidar.sources.capture.stamps import Stamp

if TYPE_CHECKING:
    from av import VideoFrame


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture of one camera.

    Args:
        picture: as decoded.
        stamp: when it was taken.
    """

    picture: VideoFrame
    stamp: Stamp

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height) as it is to be shown: a video may say that it is turned by quarters."""
        upright = round(self.picture.rotation / 90) % 2 == 0
        size_px = self.picture.width, self.picture.height
        return size_px if upright else size_px[::-1]

    def dated(self, taken_ns: int) -> Shot:
        """The same, taken at another monotonic time."""
        return replace(self, stamp=self.stamp._replace(taken_ns=taken_ns))


@dataclass(frozen=True, eq=False)
class ShotPair:
    """Pictures of one moment.

    Args:
        shots: left and right; one that holds both eyes alone.
    """

    shots: tuple[Shot, ...]

    @property
    def time_ns(self) -> int:
        """The left eye's time counts, as for recorded videos."""
        return self.shots[0].stamp.time_ns

    @property
    def taken_ns(self) -> int:
        """Monotonic time at which the pair was complete."""
        return max(shot.stamp.taken_ns for shot in self.shots)

    @property
    def apart_ns(self) -> int:
        """Difference of the times of both eyes."""
        return abs(self.shots[-1].stamp.time_ns - self.time_ns)
