"""Values of a rig file out of its JSON: each checked, each refused by its place.

A value of another form raises `CalibrationSyntax`, a key that is missing or unknown
`CalibrationField`, both with the path within the file and the line.
"""

from __future__ import annotations

import difflib
import json

import numpy as np

from pseudolidar.errors import CalibrationField, CalibrationSyntax, CalibrationValue
from pseudolidar.formats.rigs.placed import Node, at_place
from pseudolidar.structures.arrays import Float64

MINIMAL_RIG = (
    '{"schema": 1, "width_px": 1242, "height_px": 375, '
    '"left": {"fx": 721.5, "cx": 609.6, "cy": 172.9}, "baseline_m": 0.54}'
)


def fields_of(
    node: Node, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> dict[str, Node]:
    """Fields of an object that has all `required` keys and no unknown one."""
    if not isinstance(node.value, dict):
        raise wrong(node, "an object { }")
    for key, value in node.value.items():
        if key not in required + optional:
            near = difflib.get_close_matches(key, required + optional, n=1)
            raise CalibrationField(
                f"unknown key {key!r}",
                want=f"{near[0]!r}" if near else "one of " + ", ".join(required + optional),
                path=node.path,
                where=value.where,
            )
    for key in required:
        if key not in node.value:
            raise lacks(node, f"{key!r}")
    return node.value


def number(node: Node) -> float:
    """A number."""
    if isinstance(node.value, bool) or not isinstance(node.value, int | float):
        raise wrong(node, "a number")
    return float(node.value)


def count(node: Node, of: str = "pixels") -> int:
    """A whole number, at least 1."""
    if isinstance(node.value, bool) or not isinstance(node.value, int) or node.value < 1:
        raise wrong(node, f"a whole number of {of}, 1 or more")
    return node.value


def truth(node: Node) -> bool:
    """A truth value."""
    if not isinstance(node.value, bool):
        raise wrong(node, "true or false")
    return node.value


def text(node: Node) -> str:
    """A text."""
    if not isinstance(node.value, str):
        raise wrong(node, "text in double quotes")
    return node.value


def numbers(node: Node, length: int | None = None) -> Float64:
    """(n,) numbers; `length` of them where it is given."""
    if not isinstance(node.value, tuple):
        raise wrong(node, "a list of numbers [ ]")
    if length not in (None, len(node.value)):
        raise CalibrationSyntax(
            f"{len(node.value)} values", want=str(length), path=node.path, where=node.where
        )
    return np.array([number(item) for item in node.value], dtype=np.float64)


def matrix(node: Node, size: int = 3) -> Float64:
    """(size, size) numbers."""
    if not isinstance(node.value, tuple) or len(node.value) != size:
        raise wrong(node, f"{size} rows of {size} numbers, [[ ], [ ], ...]")
    return np.stack([numbers(row, size) for row in node.value])


def wrong(node: Node, want: str) -> CalibrationSyntax:
    """The error of a value of another form than `want`."""
    match node.value:
        case dict():
            got = "an object"
        case tuple():
            got = f"a list of {len(node.value)}"
        case _:
            got = json.dumps(node.value)
    return CalibrationSyntax(got, want=want, path=node.path, where=node.where)


def lacks(node: Node, key: str) -> CalibrationField:
    """The error of an object without `key`."""
    found = ", ".join(node.value) if isinstance(node.value, dict) else ""
    return CalibrationField(
        f"no {key}; keys found: {found or 'none'}",
        want=key,
        fix=f"The least that a rig needs: {MINIMAL_RIG}",
        path=node.path,
        where=node.where,
    )


def at_node(error: CalibrationValue, node: Node) -> CalibrationValue:
    """The error with the place of `node`."""
    return at_place(error, path=node.path, where=node.where)
