"""How things of a class move: what a filter expects of them before it has seen them do so."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mover:
    """Motions of a class.

    Args:
        kind: classes of one kind may be one thing, named differently from frame to frame.
        speed_m_s: one standard deviation of the speed of one that was just seen.
        wander_m_s: by how much its velocity changes within a second, one standard deviation.
    """

    kind: str
    speed_m_s: float
    wander_m_s: float


VEHICLE = Mover("vehicle", 8.0, 1.0)
PERSON = Mover("person", 1.5, 0.3)
CYCLIST = Mover("person", 5.0, 0.8)
# Older lists of COCO's classes call motorcycles so; networks take bicycles for them, and back.
MOTORBIKE = Mover("person", 8.0, 1.0)
FIXED = Mover("fixed", 0.3, 0.1)
# What has no class that is known may be any thing.
UNKNOWN = Mover("any", 3.0, 1.0)
MOVERS: dict[str, Mover] = {
    **dict.fromkeys(("car", "van", "truck", "tram", "train", "bus", "motorcycle"), VEHICLE),
    **dict.fromkeys(("pedestrian", "person", "person_sitting"), PERSON),
    **dict.fromkeys(("cyclist", "bicycle"), CYCLIST),
    "motorbike": MOTORBIKE,
    **dict.fromkeys(("traffic light", "stop sign"), FIXED),
}


def mover_of_class(name: str) -> Mover:
    """How things of a class move, `UNKNOWN` where nobody said."""
    return MOVERS.get(name.lower(), UNKNOWN)


def may_be_one(name: str, other: str) -> bool:
    """Whether two class names may be of the same thing."""
    a, b = mover_of_class(name), mover_of_class(other)
    return name == other or a.kind == b.kind or UNKNOWN in (a, b)
