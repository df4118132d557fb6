"""Labelled boxes as a Foxglove scene."""

from __future__ import annotations

from typing import Any

from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from pseudolidar.formats.mcap.items import Boxes
from pseudolidar.formats.mcap.protobuf import serialised, set_stamp
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.box import Box3D
from pseudolidar.structures.pose import Pose

# Red, green, blue, alpha, 0-1: see-through, so that the points in the box stay visible.
BOX_COLOUR = (0.2, 0.8, 0.2, 0.3)
TEXT_COLOUR = (1.0, 1.0, 1.0, 1.0)
TEXT_SIZE_PX = 14.0


def labels_message(boxes: Boxes, timestamp_ns: int) -> Parts:
    """The boxes of a frame, in the place of those before; regions to ignore are left out."""
    message = SceneUpdate()
    deletion = message.deletions.add(type=SceneEntityDeletion.ALL)
    set_stamp(deletion.timestamp, timestamp_ns)
    for identity, label, box in boxes.placed():
        _add_box(message, box, label.detection.name, f"label/{identity}", timestamp_ns)
    return serialised(message)


def _add_box(scene: Any, box: Box3D, name: str, identity: str, timestamp_ns: int) -> None:
    entity = scene.entities.add(frame_id=box.pose.dst, id=identity)
    set_stamp(entity.timestamp, timestamp_ns)
    entity.metadata.add(key="class", value=name)
    cube = entity.cubes.add()
    set_pose(cube.pose, box.pose)
    cube.size.x, cube.size.y, cube.size.z = box.length_m, box.width_m, box.height_m
    set_colour(cube.color, BOX_COLOUR)
    text = entity.texts.add(text=name, billboard=True, scale_invariant=True, font_size=TEXT_SIZE_PX)
    set_pose(text.pose, box.pose)
    set_colour(text.color, TEXT_COLOUR)


def set_pose(message: Any, pose: Pose) -> None:
    """Fill a `foxglove.Pose` with that of `pose.src`."""
    message.position.x, message.position.y, message.position.z = pose.translation_m
    w, x, y, z = quaternion_wxyz(pose.matrix[:3, :3])
    orientation = message.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = x, y, z, w


def set_colour(colour: Any, rgba: tuple[float, float, float, float]) -> None:
    """Fill a `foxglove.Color`."""
    colour.r, colour.g, colour.b, colour.a = rgba
