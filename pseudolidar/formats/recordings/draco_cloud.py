"""Clouds packed by Draco, read by DracoPy where that is installed (extra `draco`)."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from pseudolidar.errors import MissingDependency, RecordingError
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.points.point_file import check_point_limit
from pseudolidar.formats.recordings.packed_cloud import PackedField, cloud_of
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud

MAGIC = b"DRACO"
# Draco's own kinds of attributes: positions, normals and colours; others are named.
_NAMES = {0: ["x", "y", "z"], 1: ["nx", "ny", "nz"], 2: ["red", "green", "blue", "alpha"]}


def draco_cloud(data: bytes, frame: str, stamp_ns: int, *, own: bool, limits: Limits) -> PointCloud:
    """Positions, colours and named attributes of a Draco cloud; coordinates are rounded in it.

    Args:
        data: the packed cloud.
        frame: coordinate frame.
        stamp_ns: time of the cloud.
        own: whether this package wrote it.
        limits: cap on the points.

    Raises:
        MissingDependency: DracoPy is not installed.
        RecordingError: damaged.
    """
    try:
        library = importlib.import_module("DracoPy")
    except ImportError as error:
        raise MissingDependency(
            "DracoPy is not installed",
            want="the library that reads clouds packed by Draco",
            fix='pip install "pseudolidar[draco]"',
        ) from error
    if not data.startswith(MAGIC):
        raise RecordingError(f"{len(data)} bytes", want="a cloud packed by Draco")
    try:
        attributes = library.decode(data).attributes
    except Exception as error:  # DracoPy has no error of its own for damaged data
        raise RecordingError(f"damaged ({error})", want="a cloud packed by Draco") from error
    check_point_limit(len(attributes[0]["data"]) if attributes else 0, limits)
    columns = [column for attribute in attributes for column in _columns(attribute)]
    return cloud_of(columns, frame, stamp_ns, None, own=own)


def _columns(attribute: dict[str, Any]) -> list[tuple[PackedField, AnyArray]]:
    """The columns of an attribute: those of positions and colours have names of their own."""
    data = np.asarray(attribute["data"]).reshape(len(attribute["data"]), -1)
    names = _NAMES.get(attribute["attribute_type"])
    if names is None:
        title = attribute["name"] or f"attribute_{attribute['unique_id']}"
        several = data.shape[1] > 1
        names = [f"{title}_{i}" for i in range(data.shape[1])] if several else [title]
    return [
        (PackedField(name, 0, data.dtype.str[1:]), np.ascontiguousarray(column))
        for name, column in zip(names, data.T, strict=False)
    ]
