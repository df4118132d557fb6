"""Point clouds and scans as Foxglove messages: one packed little-endian record a point."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud as PointCloudMessage

from pseudolidar.errors import StructureError
from pseudolidar.formats.mcap_protobuf import Parts, set_stamp, with_data
from pseudolidar.formats.records import interleave
from pseudolidar.structures.arrays import AnyArray
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan

OPAQUE = 255

# Foxglove PackedElementField.NumericType by little-endian numpy type; the others are widened.
NUMERIC_TYPES = {
    "<u1": PackedElementField.UINT8,
    "<i1": PackedElementField.INT8,
    "<u2": PackedElementField.UINT16,
    "<i2": PackedElementField.INT16,
    "<u4": PackedElementField.UINT32,
    "<i4": PackedElementField.INT32,
    "<f4": PackedElementField.FLOAT32,
    "<f8": PackedElementField.FLOAT64,
}
# Types that the schema has no number for, and the one that holds their values (64-bit integers
# to 2^53).
WIDENED = {"bool": "<u1", "float16": "<f4", "int64": "<f8", "uint64": "<f8"}


def cloud_message(cloud: PointCloud, timestamp_ns: int, *, pixels: bool = True) -> Parts:
    """A cloud with all its columns; points without coordinates are left out.

    Args:
        cloud: fields x, y, z, then red, green, blue, alpha (uint8), intensity, sigma_m, u, v and
            its extra columns, as far as it has them.
        timestamp_ns: stamp of the message where the cloud has none.
        pixels: with u and v.

    Raises:
        StructureError: an extra column has the name of another, or is not one number a point.
        SequenceTime: neither cloud nor message has a stamp.
    """
    if cloud.shape is not None:
        cloud = cloud[cloud.valid]
    columns: dict[str, AnyArray] = dict(zip("xyz", cloud.xyz.T, strict=True))
    if cloud.rgb is not None:
        columns |= dict(zip(("red", "green", "blue"), cloud.rgb.T, strict=True))
        columns["alpha"] = np.broadcast_to(np.uint8(OPAQUE), len(cloud))
    if cloud.intensity is not None:
        columns["intensity"] = cloud.intensity
    if cloud.sigma_m is not None:
        columns["sigma_m"] = cloud.sigma_m
    if pixels and cloud.uv is not None:
        columns |= dict(zip("uv", cloud.uv.T, strict=True))
    twice = columns.keys() & cloud.extra.keys()
    if twice:
        raise StructureError(
            f"extra columns {sorted(twice)}", want="other names", where="PointCloud.extra"
        )
    columns |= cloud.extra
    return points_message(columns, cloud.frame, cloud.timestamp_ns or timestamp_ns)


def scan_message(scan: LidarScan, timestamp_ns: int) -> Parts:
    """A LiDAR scan: x, y, z, intensity (reflectance), t_s (seconds from the scan's stamp)."""
    columns = dict(zip("xyz", scan.xyz.T, strict=True))
    if scan.reflectance is not None:
        columns["intensity"] = scan.reflectance
    if scan.point_times_ns is not None:
        columns["t_s"] = ((scan.point_times_ns - scan.timestamp_ns) * 1e-9).astype(np.float32)
    return points_message(columns, scan.frame, scan.timestamp_ns or timestamp_ns)


def points_message(columns: Mapping[str, AnyArray], frame: str, timestamp_ns: int) -> Parts:
    """A serialised `foxglove.PointCloud` of (N,) columns in the order given.

    Raises:
        StructureError: a column is not one number a point.
    """
    types = {name: _stored_type(name, column) for name, column in columns.items()}
    stride = sum(np.dtype(stored).itemsize for stored in types.values())
    message = PointCloudMessage(frame_id=frame, point_stride=stride)
    set_stamp(message.timestamp, timestamp_ns)
    message.pose.orientation.w = 1.0
    offset = 0
    for name, stored in types.items():
        message.fields.add(name=name, offset=offset, type=NUMERIC_TYPES[stored])
        offset += np.dtype(stored).itemsize
    return with_data(message, interleave(columns, types))


def _stored_type(name: str, column: AnyArray) -> str:
    stored = WIDENED.get(column.dtype.name, _little_endian(column.dtype))
    if column.ndim != 1 or stored not in NUMERIC_TYPES:
        raise StructureError(
            f"{column.dtype} column of shape {column.shape}",
            want="one number a point",
            where=f"PointCloud.extra[{name!r}]",
        )
    return stored


def _little_endian(kind: np.dtype[np.generic]) -> str:
    return f"<{kind.kind}{kind.itemsize}"
