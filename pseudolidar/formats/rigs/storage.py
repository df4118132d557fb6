"""OpenCV's FileStorage and ROS's YAML: YAML, XML or JSON to one tree of values, and its matrices.

No native code: OpenCV's own reader crashes on wrong `cols` and clips values silently.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationValue,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.placed import Node
from pseudolidar.formats.rigs.strict_json import parse_json
from pseudolidar.formats.rigs.strict_xml import parse_xml
from pseudolidar.formats.rigs.strict_yaml import MATRIX_TYPES, TYPE_KEY, parse_yaml
from pseudolidar.formats.text import read_lines
from pseudolidar.structures.arrays import Float64

# No matrix of a calibration is larger (lens models have 14 numbers, projections 12, Q 16).
LARGEST_MATRIX = 64
# What OpenCV's letters of element types can hold.
ELEMENTS = {
    "u": (0, 255),
    "c": (-128, 127),
    "w": (0, 65535),
    "s": (-32768, 32767),
    "i": (-(2**31), 2**31 - 1),
    "f": (-3.4028235e38, 3.4028235e38),
    "d": (-math.inf, math.inf),
}
WHOLE_ELEMENTS = "ucwsi"
_SHAPE_KEYS = ("rows", "cols")


def read_storage(path: Path, *, limits: Limits = DEFAULT_LIMITS) -> tuple[Node, ...]:
    """The documents of a file, YAML, XML or JSON by its content; one but for YAML's `---`.

    Raises:
        CalibrationMissing: no such file.
        CalibrationSyntax: none of these, by line and column; too deep.
        CalibrationField: a key twice in one mapping.
        LimitError: larger than `limits.text_bytes`.
    """
    lines = read_lines(path, error=CalibrationSyntax, missing=CalibrationMissing, limits=limits)
    text = "\n".join(line.text for line in lines)
    start = text.lstrip()[:1]
    if start == "<":
        return (parse_xml(text, path),)
    return (parse_json(text, path),) if start == "{" else parse_yaml(text, path)


def is_matrix(node: Node) -> bool:
    """Whether a value has the form of a matrix: OpenCV's, ROS's, or a list."""
    if isinstance(node.value, dict):
        kind = node.value.get(TYPE_KEY)
        return "data" in node.value or (kind is not None and kind.value in MATRIX_TYPES)
    return isinstance(node.value, tuple)


def matrix_of(node: Node) -> Float64:
    """(rows, cols) numbers of a matrix, its channels side by side; of a flat list, one row.

    Raises:
        CalibrationField: rows, cols or data are missing.
        CalibrationSyntax: a count that does not fit, what is no number.
        CalibrationValue: a number that the element type `dt` cannot hold.
        LimitError: never; a size that is not believed is `CalibrationValue`, before allocating.
    """
    if isinstance(node.value, tuple):
        return _of_rows(node)
    if not isinstance(node.value, dict):
        raise _refused(node, repr(node.value)[:40], "a matrix: rows, cols and data")
    shape = _SHAPE_KEYS if "sizes" not in node.value else ("sizes",)
    for key in (*shape, "data"):
        if key not in node.value:
            raise CalibrationField(
                f"a matrix without {key!r}; keys found: {', '.join(node.value) or 'none'}",
                want="rows, cols and data",
                path=node.path,
                where=node.where,
            )
    rows, cols = _shape(node.value)
    channels, element = _element(node.value.get("dt"))
    if rows * cols * channels > LARGEST_MATRIX:
        raise CalibrationValue(
            f"a matrix of {rows} x {cols}",
            want=f"at most {LARGEST_MATRIX} numbers",
            path=node.path,
            where=node.where,
        )
    data = node.value["data"]
    items = data.value if isinstance(data.value, tuple) else (data,)
    if len(items) != rows * cols * channels:
        raise _refused(data, f"{len(items)} numbers", f"{rows} x {cols * channels}")
    numbers = [_number(item, element) for item in items]
    return np.array(numbers, dtype=np.float64).reshape(rows, cols * channels)


def _of_rows(node: Node) -> Float64:
    """A list of numbers, or a list of rows of them."""
    assert isinstance(node.value, tuple)
    if len(node.value) > LARGEST_MATRIX:
        raise _refused(node, f"{len(node.value)} values", f"at most {LARGEST_MATRIX}")
    rows = [row.value if isinstance(row.value, tuple) else None for row in node.value]
    if all(row is None for row in rows):
        flat = [_number(item, "d") for item in node.value]
        return np.array(flat, dtype=np.float64).reshape(1, -1)
    lengths = {-1 if row is None else len(row) for row in rows}
    if len(lengths) > 1 or max(lengths) * len(rows) > LARGEST_MATRIX:
        raise _refused(node, "rows of different or absurd lengths", "a list of rows of numbers")
    return np.array([[_number(item, "d") for item in row or ()] for row in rows], dtype=np.float64)


def _shape(fields: dict[str, Node]) -> tuple[int, int]:
    """(rows, cols); OpenCV 5 writes a vector with its `sizes` alone."""
    if "sizes" not in fields:
        rows, cols = (_size(fields[key], key) for key in _SHAPE_KEYS)
        return rows, cols
    node = fields["sizes"]
    sizes = node.value if isinstance(node.value, tuple) else (node,)
    found = [_size(item, "size") for item in sizes]
    if len(found) > 2:
        raise _refused(node, f"a matrix of {len(found)} dimensions", "1 or 2")
    return (1, found[0]) if len(found) == 1 else (found[0], found[1])


def _size(node: Node, key: str) -> int:
    value = node.value
    if isinstance(value, bool) or not isinstance(value, int):
        raise _refused(node, f"{key} {value!r}"[:40], "a whole number, 1 or more")
    if value < 1:
        raise CalibrationValue(f"{key} {value}", want="1 or more", path=node.path, where=node.where)
    return value


def _element(node: Node | None) -> tuple[int, str]:
    """Channels and letter of an element type such as `d` or `3f`; float64 where it is not said."""
    if node is None:
        return 1, "d"
    text = node.value if isinstance(node.value, str) else ""
    count, letter = text[:-1] or "1", text[-1:]
    if letter not in ELEMENTS or count not in ("1", "2", "3", "4"):
        raise _refused(node, f"dt {node.value!r}"[:40], f"one of {', '.join(ELEMENTS)}")
    return int(count), letter


def _number(node: Node, element: str) -> float:
    value = node.value
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _refused(node, f"{value!r}"[:40], "a finite decimal number such as -1.5e-3")
    low, high = ELEMENTS[element]
    if not low <= value <= high or (element in WHOLE_ELEMENTS and value != int(value)):
        raise CalibrationValue(
            f"{value:g} in a matrix of type {element!r}",
            want=f"{'whole numbers ' if element in WHOLE_ELEMENTS else ''}from {low} to {high}",
            path=node.path,
            where=node.where,
        )
    return float(value)


def _refused(node: Node, got: str, want: str) -> CalibrationSyntax:
    return CalibrationSyntax(got, want=want, path=node.path, where=node.where)
