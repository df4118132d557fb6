"""What has become of the pictures of cameras: every one is counted once."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from pseudolidar.formats.timestamps import NS_PER_S


@dataclass(frozen=True)
class EyeCounts:
    """The pictures of one camera.

    Args:
        name: left, right, or camera where one has both eyes.
        arrived: whole pictures that came.
        alone: left out because the other eye has none of that moment.
        damaged: pictures that did not arrive whole, not among those that arrived.
        damage: what was wrong with the last one of them.
        reopened: how often the camera came back after it was gone.
        waiting: for the other eye.
        fault: why there are none at the moment, "" if there are.
        interval_s: between two pictures (median of the last ones), None if not known.
    """

    name: str
    arrived: int
    alone: int
    damaged: int
    damage: str
    reopened: int
    waiting: int
    fault: str
    interval_s: float | None


@dataclass(frozen=True)
class CaptureCounts:
    """The pictures of all cameras: `arrived == formed + alone + waiting` for each of them.

    Args:
        eyes: by camera.
        formed: pairs, `formed == taken + dropped + waiting`.
        dropped: pairs that gave way to newer ones before a worker was free.
        taken: pairs that were worked on.
        waiting: pairs that nobody has taken yet.
        widest_ns: largest difference within a pair.
    """

    eyes: tuple[EyeCounts, ...]
    formed: int
    dropped: int
    taken: int
    waiting: int
    widest_ns: int

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        found = asdict(self)
        eyes = {eye.pop("name"): eye for eye in found.pop("eyes")}
        widest_s = found.pop("widest_ns") / NS_PER_S
        return {**found, "widest_s": widest_s, "cameras": eyes}
