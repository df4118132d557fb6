"""Point clouds as Foxglove messages: one packed little-endian record a point."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud as PointCloudMessage

from pseudolidar.formats.mcap.columns import stored_type
from pseudolidar.formats.mcap.items import Points
from pseudolidar.formats.mcap.protobuf import set_stamp, with_data
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.points.records import interleave

# Foxglove PackedElementField.NumericType by little-endian numpy type.
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


def points_message(points: Points, timestamp_ns: int) -> Parts:
    """A serialised `foxglove.PointCloud` of the columns in the order given.

    Raises:
        StructureError: a column is not one number a point.
        SequenceTime: neither the points nor the message have a stamp.
    """
    types = {name: stored_type(name, column) for name, column in points.columns.items()}
    stride = sum(np.dtype(stored).itemsize for stored in types.values())
    message = PointCloudMessage(frame_id=points.frame, point_stride=stride)
    set_stamp(message.timestamp, points.stamp_ns or timestamp_ns)
    message.pose.orientation.w = 1.0
    offset = 0
    for name, stored in types.items():
        message.fields.add(name=name, offset=offset, type=NUMERIC_TYPES[stored])
        offset += np.dtype(stored).itemsize
    return with_data(message, interleave(points.columns, types))
