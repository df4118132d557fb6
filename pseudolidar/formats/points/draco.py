"""Clouds packed by Draco, through the optional library DracoPy.

Source: Draco bitstream specification, google.github.io/draco/spec.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np

from pseudolidar.errors import MissingDependency
from pseudolidar.formats.mcap.columns import ALPHA, COLOURS
from pseudolidar.structures.arrays import AnyArray

# Largest error of a coordinate, m. Bits follow from it and from the extent of the cloud; each is
# rounded to the middle, so a step is twice as large.
ERROR_M = 0.001
# Draco's own caps; beyond 30 bits a cloud is larger than it would be unpacked.
MIN_BITS, MAX_BITS = 1, 30
# 0 to 10; on a KITTI cloud of 250 000 points any takes 1.5 s or more, and saves 45 % (2026-11-25).
LEVEL = 1
# Attributes that DracoPy can write; others are written as these.
_AS_IS = {"uint8", "uint16", "uint32", "float32"}

DRACO_MEANING = {
    "x, y, z": f"rounded, by at most {ERROR_M * 1000:g} mm each; points in another order",
    "columns": "attributes of their names: integers from 0 to 2^32 as they are, others as float32",
}


def encode_draco(columns: Mapping[str, AnyArray]) -> bytes:
    """A cloud as Draco file: x, y, z to a millimetre, colours, and every other column by name.

    Args:
        columns: (N,) each, x, y, z among them; finite.

    Raises:
        MissingDependency: DracoPy is not installed.
    """
    library = _draco()
    xyz = np.stack([columns[axis] for axis in "xyz"], axis=1).astype(np.float32)
    colours = None
    if COLOURS[0] in columns:
        names = [*COLOURS, ALPHA] if ALPHA in columns else [*COLOURS]
        colours = np.stack([columns[name] for name in names], axis=1)
    others = {
        name: _attribute(column)
        for name, column in columns.items()
        if name not in ("x", "y", "z", *COLOURS, ALPHA)
    }
    origin = xyz.min(axis=0) if len(xyz) else np.zeros(3, np.float32)
    extent_m = float((xyz - origin).max(initial=0.0))
    packed: bytes = library.encode(
        xyz,
        quantization_bits=_bits(extent_m),
        compression_level=LEVEL,
        quantization_range=max(extent_m, ERROR_M),
        quantization_origin=origin,
        colors=colours,
        generic_attributes=others or None,
    )
    return packed


def _bits(extent_m: float) -> int:
    """Bits for steps of at most twice the error."""
    steps = max(extent_m / (2 * ERROR_M), 1.0)
    return min(max(math.ceil(math.log2(steps + 1)), MIN_BITS), MAX_BITS)


def _attribute(column: AnyArray) -> AnyArray:
    kind = column.dtype
    if kind.name in _AS_IS:
        stored: Any = column
    elif kind.kind == "b":
        stored = column.astype(np.uint8)
    elif kind.kind in "iu" and len(column) and column.min() >= 0 and column.max() < 2**32:
        stored = column.astype(np.uint32)
    else:
        stored = column.astype(np.float32)
    return np.ascontiguousarray(stored).reshape(-1, 1)


def _draco() -> ModuleType:
    try:
        return importlib.import_module("DracoPy")
    except ImportError as error:
        raise MissingDependency(
            "DracoPy is not installed",
            want="the extra `draco`",
            fix='pip install "pseudolidar[draco]", or leave out --mcap.cloud-format draco.',
        ) from error
