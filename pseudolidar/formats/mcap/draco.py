"""Clouds packed by Draco as Foxglove messages."""

from __future__ import annotations

from foxglove_schemas_protobuf.CompressedPointCloud_pb2 import CompressedPointCloud

from pseudolidar.formats.mcap.items import Points
from pseudolidar.formats.mcap.protobuf import set_stamp, with_data
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.points.draco import encode_draco


def draco_message(points: Points, timestamp_ns: int) -> Parts | None:
    """A `foxglove.CompressedPointCloud`; None of no points, which Draco cannot pack."""
    if not len(points.columns["x"]):
        return None
    message = CompressedPointCloud(frame_id=points.frame, format="draco")
    set_stamp(message.timestamp, points.stamp_ns or timestamp_ns)
    message.pose.orientation.w = 1.0
    return with_data(message, encode_draco(points.columns))
