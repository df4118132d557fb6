"""`--crop box`, `--crop range`: only the points in a box of a frame, or at some distance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pseudolidar.clouds.tool import SEEN_FROM, Tooled, count, kept, origin_of
from pseudolidar.errors import CalibrationField, UsageError
from pseudolidar.geometry.frame_chain import chain
from pseudolidar.structures.arrays import AnyArray, Bool
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.pose import Pose


@dataclass(frozen=True)
class Interval:
    """Metres from one end to the other, as `2:40`, `:1.5` or `-10:`.

    Args:
        low_m: lower end, -inf where it is open.
        high_m: upper end, inf where it is open.
    """

    low_m: float = -math.inf
    high_m: float = math.inf

    def __post_init__(self) -> None:
        if not self.low_m < self.high_m:
            raise UsageError(f"{self.low_m:g} to {self.high_m:g} m", want="the lower end first")

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `LOW:HIGH`, either of which may be left out.

        Raises:
            UsageError: not two numbers in order.
        """
        low, colon, high = text.partition(":")
        try:
            if not colon:
                raise ValueError
            return cls(
                float(low) if low.strip() else -math.inf, float(high) if high.strip() else math.inf
            )
        except ValueError:
            raise UsageError(f"{text!r}", want="LOW:HIGH in metres, such as 2:40 or :1.5") from None

    def __str__(self) -> str:
        low, high = ("" if math.isinf(end) else f"{end:g}" for end in (self.low_m, self.high_m))
        return f"{low}:{high}"

    def holds(self, values: AnyArray) -> Bool:
        """(N,) whether values lie in it, ends included; NaN does not."""
        return np.asarray((values >= self.low_m) & (values <= self.high_m))


@dataclass(frozen=True)
class Box:
    """Keep points in a box along the axes of a frame.

    Args:
        x: along its x axis, LOW:HIGH in metres.
        y: along its y axis; write --crop.y=-10:10 where the lower end is negative.
        z: along its z axis.
        frame: the frame; the cloud's own by default.
    """

    x: Interval | None = None
    y: Interval | None = None
    z: Interval | None = None
    frame: str | None = None

    def load(self) -> Self:
        """Itself: it is light."""
        return self

    def __call__(self, cloud: PointCloud, tree: tuple[Pose, ...]) -> Tooled:
        """The points inside.

        Raises:
            CalibrationField: no transforms lead from the cloud to the box's frame.
        """
        xyz = cloud.xyz
        if self.frame is not None and self.frame != cloud.frame:
            T_box_cloud = chain(tree, self.frame, cloud.frame)
            if T_box_cloud is None:
                names = {name for pose in tree for name in (pose.dst, pose.src)}
                known = sorted(names - {SEEN_FROM})
                raise CalibrationField(
                    f"no transforms from {cloud.frame!r} to {self.frame!r}",
                    want=f"one of {', '.join(known) or cloud.frame}",
                    where="--crop.frame",
                )
            xyz = T_box_cloud.apply(xyz.astype(np.float64))  # maps may be far away
        inside = cloud.valid
        for axis, interval in zip(xyz.T, (self.x, self.y, self.z), strict=True):
            if interval is not None:
                inside &= interval.holds(axis)
        return _cropped(cloud, inside)


@dataclass(frozen=True)
class Range:
    """Keep points at some distance from the sensor.

    Args:
        distance: LOW:HIGH in metres.
    """

    distance: Interval

    def load(self) -> Self:
        """Itself: it is light."""
        return self

    def __call__(self, cloud: PointCloud, tree: tuple[Pose, ...]) -> Tooled:
        """The points whose distance from where they were seen is in it."""
        away = cloud.xyz - origin_of(cloud, tree).astype(cloud.xyz.dtype)
        return _cropped(cloud, self.distance.holds(np.sqrt((away * away).sum(axis=1))))


def _cropped(cloud: PointCloud, inside: Bool) -> Tooled:
    cropped = kept(cloud, inside)
    return Tooled(cropped, {"points_cropped": count(cloud) - count(cropped)})
