"""How large things of a class usually are: what cannot be seen of them is taken from here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pseudolidar.structures.arrays import Float64

# Faces of boxes around things lie so far before their surface: that of 22 objects of KITTI to 30 m,
# by the LiDAR (median), m.
ROUND_M = 0.1


@dataclass(frozen=True)
class ClassSize:
    """Sizes of a class, m: a mean and one standard deviation each.

    Args:
        length_m: forward.
        width_m: sideways.
        height_m: upwards.
        stands: on the ground, as all but signs, lights and things that fly do.
        round_m: how far its surface lies behind the faces of a box around it, as things are round
            at corners and bumpers; 0 for what may be flat.
    """

    length_m: tuple[float, float]
    width_m: tuple[float, float]
    height_m: tuple[float, float]
    stands: bool = True
    round_m: float = ROUND_M

    @property
    def mean_m(self) -> Float64:
        """(3,) length, width, height."""
        return np.array([self.length_m[0], self.width_m[0], self.height_m[0]])

    @property
    def sigma_m(self) -> Float64:
        """(3,) one standard deviation of these."""
        return np.array([self.length_m[1], self.width_m[1], self.height_m[1]])


CAR = ClassSize((3.9, 0.45), (1.65, 0.12), (1.53, 0.14))
PERSON = ClassSize((0.8, 0.25), (0.65, 0.15), (1.74, 0.14))
CYCLIST = ClassSize((1.76, 0.2), (0.6, 0.15), (1.74, 0.12))
BUS = ClassSize((11.5, 2.5), (2.55, 0.2), (3.2, 0.3))
# Anything: as deep as wide, from a post to a shed.
UNKNOWN = ClassSize((1.5, 1.5), (1.2, 1.2), (1.5, 1.2), stands=False, round_m=0.0)
FOUND = ClassSize((1.5, 1.5), (1.2, 1.2), (1.5, 1.2), stands=False)
# KITTI's means over its training labels; of COCO's classes what such things are built like.
SIZES: dict[str, ClassSize] = {
    "car": CAR,
    "van": ClassSize((5.1, 0.8), (1.9, 0.17), (2.2, 0.32)),
    "truck": ClassSize((10.0, 3.4), (2.6, 0.22), (3.25, 0.45)),
    "tram": ClassSize((16.0, 7.0), (2.5, 0.2), (3.5, 0.2)),
    "train": ClassSize((20.0, 8.0), (2.9, 0.3), (3.8, 0.4)),
    "bus": BUS,
    "pedestrian": PERSON,
    "person": PERSON,
    "person_sitting": ClassSize((0.8, 0.25), (0.6, 0.1), (1.27, 0.12)),
    "cyclist": CYCLIST,
    "bicycle": ClassSize((1.7, 0.2), (0.5, 0.15), (1.1, 0.3)),
    "motorcycle": ClassSize((2.1, 0.25), (0.8, 0.15), (1.3, 0.3)),
    # what is found by its points alone: anything, and mostly as round as cars and people are
    "thing": FOUND,
    "obstacle": FOUND,
    "misc": ClassSize((3.6, 2.0), (1.5, 0.7), (1.9, 0.8)),
    "dog": ClassSize((0.9, 0.3), (0.3, 0.1), (0.6, 0.2)),
    "traffic light": ClassSize((0.3, 0.1), (0.35, 0.1), (0.9, 0.25), stands=False, round_m=0.0),
    "stop sign": ClassSize((0.1, 0.1), (0.75, 0.1), (0.75, 0.1), stands=False, round_m=0.0),
}


def size_of_class(name: str) -> ClassSize:
    """The usual size of a class, `UNKNOWN` where nobody said."""
    return SIZES.get(name.lower(), UNKNOWN)
