"""Names of the procedural surfaces that `surfaces.py` knows how to colour."""

from __future__ import annotations

from enum import IntEnum


class Material(IntEnum):
    """What a triangle is made of; decides its texture in `surfaces.albedo`."""

    PLAIN = 0
    ASPHALT = 1
    PAVEMENT = 2
    GRASS = 3
    BRICK = 4
    PLASTER = 5
    FACADE = 6
    ROOF = 7
    PAINT = 8
    CABIN = 9
    RUBBER = 10
    CLOTH = 11
    BARK = 12
    LEAF = 13
    METAL = 14
    PLANKS = 15
    POSTER = 16
    SHELF = 17
    FIELD = 18
    GRAVEL = 19
    SIGN = 20
