"""Obstacles as a Foxglove scene, and as annotations of the left image."""

from __future__ import annotations

from typing import Any

import numpy as np
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from pseudolidar.formats.mcap.items import Obstacles
from pseudolidar.formats.mcap.protobuf import serialised, set_stamp
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.mcap.scene import TEXT_COLOUR, TEXT_SIZE_PX, set_colour, set_pose
from pseudolidar.formats.obstacle_words import colour_by_distance, moves, words
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, Track
from pseudolidar.structures.obstacle import Obstacle

SEE_THROUGH, OPAQUE = 0.3, 1.0
# What coasts is paler than what is seen by this.
PALER = 0.35
# An arrow is as long as the way of this time, s.
ARROW_S = 1.0
SHAFT_M, HEAD_M = 0.12, 0.35
LINE_PX, FONT_PX = 2.0, 12.0
LEAST_LENGTH = 1e-9
TEXT_GROUND = (0.0, 0.0, 0.0, 0.6)


def obstacles_message(content: Obstacles, timestamp_ns: int) -> Parts:
    """Boxes with what is known of them, arrows of velocity, in the place of those before."""
    message = SceneUpdate()
    deletion = message.deletions.add(type=SceneEntityDeletion.ALL)
    set_stamp(deletion.timestamp, timestamp_ns)
    for number, obstacle in enumerate(content.obstacles, start=1):
        _add_entity(message, obstacle, number, timestamp_ns)
    return serialised(message)


def annotations_message(content: Obstacles, timestamp_ns: int) -> Parts:
    """Boxes in the left image with what is known of them, the far ones first."""
    message = ImageAnnotations()
    set_stamp(message.timestamp, timestamp_ns)
    for obstacle in sorted(content.obstacles, key=lambda one: -one.distance_m):
        left, top, right, bottom = obstacle.detection.box_px
        colour = _colour(obstacle, OPAQUE)
        box = message.points.add(type=PointsAnnotation.LINE_LOOP, thickness=LINE_PX)
        set_stamp(box.timestamp, timestamp_ns)
        for x, y in ((left, top), (right, top), (right, bottom), (left, bottom)):
            box.points.add(x=x, y=y)
        set_colour(box.outline_color, colour)
        text = message.texts.add(text="\n".join(words(obstacle)), font_size=FONT_PX)
        set_stamp(text.timestamp, timestamp_ns)
        text.position.x, text.position.y = left, top
        set_colour(text.text_color, colour)
        set_colour(text.background_color, TEXT_GROUND)
    return serialised(message)


def _add_entity(scene: Any, obstacle: Obstacle, number: int, timestamp_ns: int) -> None:
    box, track = obstacle.box, obstacle.track
    identity = f"frame/{number}" if track is None else f"track/{track.track_id}"
    entity = scene.entities.add(frame_id=box.pose.dst, id=identity)
    set_stamp(entity.timestamp, timestamp_ns)
    for key, value in _facts(obstacle).items():
        entity.metadata.add(key=key, value=value)
    cube = entity.cubes.add()
    set_pose(cube.pose, box.pose)
    cube.size.x, cube.size.y, cube.size.z = box.length_m, box.width_m, box.height_m
    set_colour(cube.color, _colour(obstacle, SEE_THROUGH))
    text = entity.texts.add(
        text="\n".join(words(obstacle)),
        billboard=True,
        scale_invariant=True,
        font_size=TEXT_SIZE_PX,
    )
    set_pose(text.pose, box.pose)
    set_colour(text.color, TEXT_COLOUR)
    if track is not None and moves(obstacle):
        _add_arrow(entity, track, box, _colour(obstacle, OPAQUE))


def _add_arrow(
    entity: Any, track: Track, box: Box3D, colour: tuple[float, float, float, float]
) -> None:
    length_m = ARROW_S * float(np.linalg.norm(track.velocity_m_s))
    arrow = entity.arrows.add(
        shaft_length=max(length_m - HEAD_M, 0.0),
        shaft_diameter=SHAFT_M,
        head_length=min(HEAD_M, length_m),
        head_diameter=2 * SHAFT_M,
    )
    position, turned = arrow.pose.position, arrow.pose.orientation
    position.x, position.y, position.z = box.pose.translation_m
    turned.w, turned.x, turned.y, turned.z = quaternion_wxyz(_along(track.velocity_m_s))
    set_colour(arrow.color, colour)


def _along(direction: Float64) -> Float64:
    """(3, 3) rotation whose x axis points in a direction."""
    x = direction / max(float(np.linalg.norm(direction)), LEAST_LENGTH)
    other = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(other, x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _facts(obstacle: Obstacle) -> dict[str, str]:
    facts = {
        "class": obstacle.detection.name,
        "distance_m": f"{obstacle.distance_m:.3f}",
        "sigma_distance_m": f"{obstacle.sigma_distance_m:.3f}",
        "confidence": f"{obstacle.confidence:.3f}",
        "measured_by": obstacle.measured_by,
    }
    track = obstacle.track
    if track is not None:
        facts |= {"track": str(track.track_id), "track_state": track.state}
        if track.contact is not None:
            facts["contact_s"] = f"{track.contact.time_s:.3f}"
        if obstacle.coasts:
            facts["unseen_s"] = f"{track.unseen_s:.3f}"
    return facts


def _colour(obstacle: Obstacle, alpha: float) -> tuple[float, float, float, float]:
    red, green, blue = colour_by_distance(obstacle.distance_m)
    return red / 255, green / 255, blue / 255, alpha * (PALER if obstacle.coasts else 1.0)
