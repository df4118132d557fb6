"""Obstacles as messages of ROS 2 interfaces."""

from __future__ import annotations

from typing import Any

from pseudolidar.formats.mcap.items import Obstacles
from pseudolidar.formats.mcap.obstacle_edges import number_of
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.mcap.scene import TEXT_COLOUR
from pseudolidar.formats.obstacle_words import colour_by_distance, moves, words
from pseudolidar.formats.ros.cdr import encode_ros2
from pseudolidar.formats.ros.ros2_messages import (
    ADD,
    CUBE,
    DELETE_ALL,
    TEXT_M,
    TEXT_VIEW_FACING,
    box_size,
    header,
    ros_colour,
    ros_pose,
    vector,
)
from pseudolidar.structures.obstacle import Obstacle

# visualization_msgs/Marker: an arrow between two points; diameters of its shaft and head, m.
ARROW, SHAFT_M, HEAD_M = 0, 0.12, 0.3
SEE_THROUGH, OPAQUE = 0.3, 1.0
# What coasts is paler than what is seen by this.
PALER = 0.35
# An arrow is as long as the way of this time, s.
ARROW_S = 1.0


def obstacle_markers_message(content: Obstacles, time_ns: int) -> Parts:
    """Boxes, what is known of them, and arrows of velocity, in the place of those before."""
    markers: list[dict[str, Any]] = [
        {"header": header(content.frame, time_ns), "action": DELETE_ALL}
    ]
    for number, obstacle in enumerate(content.obstacles, start=1):
        markers += _markers(obstacle, number_of(obstacle, number), time_ns)
    return encode_ros2("visualization_msgs/MarkerArray", {"markers": markers})


def obstacle_detections_message(content: Obstacles, time_ns: int) -> Parts:
    """Boxes for programs, with the covariance of their centres in the camera's axes.

    Those that are seen alone: a detection cannot say that it is only predicted.
    """
    detections = []
    for number, obstacle in enumerate(content.obstacles, start=1):
        if obstacle.coasts:
            continue
        box = obstacle.box
        hypothesis = {"class_id": obstacle.detection.name, "score": obstacle.detection.score}
        pose = ros_pose(box.pose)
        result = {
            "hypothesis": hypothesis,
            "pose": {"pose": pose, "covariance": _covariance(obstacle)},
        }
        detections.append(
            {
                "header": header(box.pose.dst, time_ns),
                "results": [result],
                "bbox": {"center": pose, "size": box_size(box)},
                "id": str(number_of(obstacle, number)),
            }
        )
    values = {"header": header(content.frame, time_ns), "detections": detections}
    return encode_ros2("vision_msgs/Detection3DArray", values)


def _markers(obstacle: Obstacle, identity: int, time_ns: int) -> list[dict[str, Any]]:
    box, track = obstacle.box, obstacle.track
    share = PALER if obstacle.coasts else 1.0
    colour = tuple(part / 255 for part in colour_by_distance(obstacle.distance_m))
    common = {"header": header(box.pose.dst, time_ns), "id": identity, "action": ADD}
    placed = common | {"pose": ros_pose(box.pose)}
    cube = {
        "ns": "obstacles",
        "type": CUBE,
        "scale": box_size(box),
        "color": ros_colour((*colour, SEE_THROUGH * share)),
    }
    text = {
        "ns": "words",
        "type": TEXT_VIEW_FACING,
        "scale": {"z": TEXT_M},
        "color": ros_colour(TEXT_COLOUR),
        "text": "\n".join(words(obstacle)),
    }
    markers = [placed | cube, placed | text]
    if track is not None and moves(obstacle):
        centre = box.pose.translation_m
        arrow = {
            "ns": "velocities",
            "type": ARROW,
            "pose": {"orientation": {"w": 1.0}},
            "scale": {"x": SHAFT_M, "y": HEAD_M},
            "color": ros_colour((*colour, OPAQUE * share)),
            "points": [vector(centre), vector(centre + ARROW_S * track.velocity_m_s)],
        }
        markers.append(common | arrow)
    return markers


def _covariance(obstacle: Obstacle) -> list[float]:
    """(36,) row-major: of the centre in the camera's axes; of the turn about the vertical."""
    assert obstacle.box.sigma_m is not None  # of every obstacle
    R, sigma = obstacle.box.pose.matrix[:3, :3], obstacle.box.sigma_m[:3]
    values = [0.0] * 36
    for row in range(3):
        for column in range(3):
            terms = R[row] * R[column] * sigma * sigma
            values[6 * row + column] = float(terms[0] + terms[1] + terms[2])
    values[28] = obstacle.sigma_heading_rad**2  # the camera's y axis, which is upright
    return values
