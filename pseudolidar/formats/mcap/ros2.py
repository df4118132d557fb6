"""The ROS 2 profile of recordings: its topics, schemas and qualities of service."""

from __future__ import annotations

import struct

from pseudolidar.formats.mcap import channels as names
from pseudolidar.formats.mcap import meanings
from pseudolidar.formats.mcap.items import Kind
from pseudolidar.formats.mcap.profile import Profile, Schema, Topic
from pseudolidar.formats.ros.cdr import definition_text, schema_name
from pseudolidar.formats.ros.ros2_messages import (
    camera_message,
    detections_message,
    disparity_message,
    fixed_message,
    log_message,
    markers_message,
    moving_message,
    odometry_message,
    path_message,
    picture_message,
    points_message,
    pose_message,
    raster_message,
)
from pseudolidar.formats.ros.ros2_obstacles import (
    obstacle_detections_message,
    obstacle_markers_message,
)

CDR, ROS2MSG = "cdr", "ros2msg"
# Where the name begins in a serialised rcl_interfaces/Log: after the encapsulation, the stamp and
# the level, aligned to 4 bytes.
LOG_NAME_AT = 16


def qos_profile(*, transient_local: bool = False) -> str:
    """`offered_qos_profiles` of a topic, as rosbag2 stores it: reliable, 10 or, kept, 1 deep.

    Numbers are those of rmw: history 1 = keep last, reliability 1 = reliable, durability
    1 = transient local, 2 = volatile; liveliness 1 = automatic.
    """
    never = "sec: 9223372036\n    nsec: 854775807"
    return (
        "- history: 1\n"
        f"  depth: {1 if transient_local else 10}\n"
        "  reliability: 1\n"
        f"  durability: {1 if transient_local else 2}\n"
        f"  deadline:\n    {never}\n"
        f"  lifespan:\n    {never}\n"
        "  liveliness: 1\n"
        f"  liveliness_lease_duration:\n    {never}\n"
        "  avoid_ros_namespace_conventions: false"
    )


def _frame_name(data: bytes) -> str:
    (length,) = struct.unpack_from("<I", data, LOG_NAME_AT)
    name = data[LOG_NAME_AT + 4 :][: length - 1]
    if not length or len(name) != length - 1:
        raise ValueError("a line of the log that ends within its name")
    return name.decode()


def _schema(kind: str) -> Schema:
    return Schema(schema_name(kind), ROS2MSG, definition_text(kind).encode())


LOG = _schema("rcl_interfaces/Log")
TF = _schema("tf2_msgs/TFMessage")
PICTURE = _schema("sensor_msgs/CompressedImage")
CAMERA = _schema("sensor_msgs/CameraInfo")
RAW = _schema("sensor_msgs/Image")
DISPARITY = _schema("stereo_msgs/DisparityImage")
CLOUD = _schema("sensor_msgs/PointCloud2")
ODOMETRY = _schema("nav_msgs/Odometry")
POSE = _schema("geometry_msgs/PoseStamped")
PATH = _schema("nav_msgs/Path")
MARKERS = _schema("visualization_msgs/MarkerArray")
DETECTIONS = _schema("vision_msgs/Detection3DArray")

QOS = "offered_qos_profiles"
OFFERED = {QOS: qos_profile()}
LATCHED = {QOS: qos_profile(transient_local=True)}
DEPTH = OFFERED | meanings.DEPTH_MEANING
CAMERA_DEPTH = OFFERED | meanings.CAMERA_DEPTH_MEANING
MAP = LATCHED | meanings.POINTS_MEANING
CLOUDS = OFFERED | meanings.POINTS_MEANING
SCAN = OFFERED | meanings.SCAN_MEANING | {"time": "seconds of the point from the stamp"}
DISPARITIES = OFFERED | {
    "unit": "px",
    "invalid": "NaN",
    "sign": "x_left - x_right - (cx_left - cx_right)",
    "correction": meanings.DISPARITY_MEANING["correction"],
}

ROS2 = Profile(
    name="ros2",
    header="ros2",
    encoding=CDR,
    frame_name=_frame_name,
    topics=(
        Topic(names.FRAME, Kind.MARK, LOG, log_message, OFFERED | meanings.MARK_MEANING),
        Topic(names.LOG, Kind.NOTE, LOG, log_message, OFFERED),
        Topic(names.TRANSFORMS, Kind.TRANSFORMS, TF, moving_message, OFFERED),
        Topic("/tf_static", Kind.TRANSFORMS, TF, fixed_message, LATCHED),
        Topic("/odometry", Kind.POSE, ODOMETRY, odometry_message, OFFERED),
        Topic(names.POSE, Kind.POSE, POSE, pose_message, OFFERED),
        Topic("/camera/left/image/compressed", Kind.LEFT_IMAGE, PICTURE, picture_message, OFFERED),
        Topic("/camera/left/camera_info", Kind.LEFT_CAMERA, CAMERA, camera_message, OFFERED),
        Topic(
            "/camera/right/image/compressed", Kind.RIGHT_IMAGE, PICTURE, picture_message, OFFERED
        ),
        Topic("/camera/right/camera_info", Kind.RIGHT_CAMERA, CAMERA, camera_message, OFFERED),
        Topic(names.DISPARITY, Kind.DISPARITY, DISPARITY, disparity_message, DISPARITIES),
        Topic(names.DEPTH, Kind.DEPTH, RAW, raster_message, DEPTH),
        Topic(names.DEPTH + "/compressed", Kind.DEPTH_PNG, PICTURE, picture_message, DEPTH),
        Topic(names.STEREO_POINTS, Kind.STEREO_POINTS, CLOUD, points_message, CLOUDS),
        Topic(names.SCAN, Kind.SCAN, CLOUD, points_message, SCAN),
        Topic(names.LABELS, Kind.LABELS, MARKERS, markers_message, OFFERED),
        Topic(names.LABELS + "/boxes", Kind.LABELS, DETECTIONS, detections_message, OFFERED),
        Topic("/camera/image/compressed", Kind.IMAGE, PICTURE, picture_message, OFFERED),
        Topic("/camera/camera_info", Kind.CAMERA, CAMERA, camera_message, OFFERED),
        Topic(names.CAMERA_DEPTH, Kind.CAMERA_DEPTH, RAW, raster_message, CAMERA_DEPTH),
        Topic(
            names.CAMERA_DEPTH + "/compressed",
            Kind.CAMERA_DEPTH_PNG,
            PICTURE,
            picture_message,
            CAMERA_DEPTH,
        ),
        Topic(names.POINTS, Kind.POINTS, CLOUD, points_message, CLOUDS),
        Topic(names.OBSTACLES, Kind.OBSTACLES, MARKERS, obstacle_markers_message, OFFERED),
        Topic(
            names.OBSTACLES + "/boxes",
            Kind.OBSTACLES,
            DETECTIONS,
            obstacle_detections_message,
            OFFERED,
        ),
        Topic(names.OBSTACLE_EDGES, Kind.OBSTACLE_EDGES, CLOUD, points_message, OFFERED),
        Topic(names.PATH, Kind.PATH, PATH, path_message, LATCHED),
        Topic(names.MAP_POINTS, Kind.MAP_POINTS, CLOUD, points_message, MAP),
    ),
)
