"""Things of a frame as messages of ROS 2 interfaces (CDR), written without ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pseudolidar.formats.mcap.columns import ALPHA, COLOURS, POINT_TIME, stored_type
from pseudolidar.formats.mcap.items import (
    Boxes,
    CameraModel,
    Disparity,
    Note,
    Picture,
    Points,
    Raster,
    Transforms,
    Way,
)
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.mcap.scene import BOX_COLOUR, TEXT_COLOUR
from pseudolidar.formats.points.records import interleave
from pseudolidar.formats.ros.cdr import encode_ros2
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.arrays import AnyArray, Float32
from pseudolidar.structures.box import Box3D
from pseudolidar.structures.pose import Pose

# rcl_interfaces/Log.INFO.
INFO = 20
# Numbers of sensor_msgs/PointField by little-endian numpy type.
POINT_FIELD_TYPES = {
    "<i1": 1,
    "<u1": 2,
    "<i2": 3,
    "<u2": 4,
    "<i4": 5,
    "<u4": 6,
    "<f4": 7,
    "<f8": 8,
}
# What drivers call the seconds of a point from the scan's stamp.
ROS_POINT_TIME = "time"
# visualization_msgs/Marker: types and actions.
CUBE, TEXT_VIEW_FACING = 1, 9
ADD, DELETE_ALL = 0, 3
# Height of a label's text, and its distance above the box, m.
TEXT_M = 0.5


def log_message(note: Note, time_ns: int) -> Parts:
    """A line of the log."""
    values = {"stamp": stamp(time_ns), "level": INFO, "name": note.name, "msg": note.text}
    return encode_ros2("rcl_interfaces/Log", values | {"file": note.detail})


def moving_message(tree: Transforms, time_ns: int) -> Parts | None:
    """Transforms that change."""
    return transforms_message(tree.moving, time_ns) if tree.moving else None


def fixed_message(tree: Transforms, time_ns: int) -> Parts | None:
    """Transforms that do not change, repeated with every frame so that seeking works."""
    return transforms_message(tree.fixed, time_ns) if tree.fixed else None


def transforms_message(poses: Sequence[Pose], time_ns: int) -> Parts:
    """`T_parent_child` of each pose."""
    transforms = [
        {
            "header": header(pose.dst, time_ns),
            "child_frame_id": pose.src,
            "transform": {
                "translation": vector(pose.translation_m),
                "rotation": quaternion(pose),
            },
        }
        for pose in poses
    ]
    return encode_ros2("tf2_msgs/TFMessage", {"transforms": transforms})


def odometry_message(pose: Pose, time_ns: int) -> Parts:
    """Where the body is; no covariances and velocities are known."""
    values = {
        "header": header(pose.dst, time_ns),
        "child_frame_id": pose.src,
        "pose": {"pose": ros_pose(pose)},
        "twist": {},
    }
    return encode_ros2("nav_msgs/Odometry", values)


def pose_message(pose: Pose, time_ns: int) -> Parts:
    """Where the body is."""
    values = {"header": header(pose.dst, time_ns), "pose": ros_pose(pose)}
    return encode_ros2("geometry_msgs/PoseStamped", values)


def path_message(way: Way, time_ns: int) -> Parts:
    """Where the body was until now."""
    poses = [
        {"header": header(pose.dst, stamp_ns), "pose": ros_pose(pose)}
        for pose, stamp_ns in zip(way.poses, way.stamps_ns, strict=True)
    ]
    values = {"header": header(way.poses[0].dst, time_ns), "poses": poses}
    return encode_ros2("nav_msgs/Path", values)


def camera_message(model: CameraModel, time_ns: int) -> Parts:
    """A rectified camera; both of a pair are in the left one's frame, as stereo has it in ROS."""
    camera = model.camera
    values = {
        "header": header(model.left, time_ns),
        "height": camera.height_px,
        "width": camera.width_px,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": camera.K.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": model.P.ravel().tolist(),
    }
    return encode_ros2("sensor_msgs/CameraInfo", values)


def picture_message(picture: Picture, time_ns: int) -> Parts:
    """A JPEG or PNG; the format names its pixels too, as `image_transport` writes it."""
    pixels, kind = picture.pixels, picture.kind
    # Encoders write colours in the order that the file format has; decoders hand out BGR.
    decoded = {"rgb8": "bgr8", "rgb16": "bgr16"}.get(pixels, pixels)
    values = {
        "header": header(picture.left, time_ns),
        "format": f"{pixels}; {kind} compressed {decoded}",
        "data": picture.data,
    }
    return encode_ros2("sensor_msgs/CompressedImage", values)


def raster_message(raster: Raster, time_ns: int) -> Parts:
    """A raw picture."""
    return encode_ros2("sensor_msgs/Image", _image(raster, time_ns))


def disparity_message(disparity: Disparity, time_ns: int) -> Parts:
    """Disparity with what turns it into depth, `Z = f t / d`.

    ROS takes a point at infinity to have disparity 0: where the two principal points differ, their
    difference is added (`d = x_l - x_r - (cx_l - cx_r)`), which moves all values alike.
    """
    rig = disparity.rig
    values = disparity.disparity.values.astype("<f4", copy=False)
    if rig.doffs_px:
        values = values + np.float32(rig.doffs_px)
    known = values[np.isfinite(values)]
    width, height = rig.left.size_px
    message = {
        "header": header(rig.left.frame, time_ns),
        "image": _image(Raster(values, "32FC1", rig.left.frame), time_ns),
        "f": rig.left.focal_px,
        "t": rig.baseline_m,
        "valid_window": {"height": height, "width": width},
        "min_disparity": float(known.min()) if len(known) else 0.0,
        "max_disparity": float(known.max()) if len(known) else 0.0,
        "delta_d": _median_sigma(disparity.disparity.sigma),
    }
    return encode_ros2("stereo_msgs/DisparityImage", message)


def points_message(points: Points, time_ns: int) -> Parts:
    """A `PointCloud2` of all columns; colours are one field `rgb`, time of a point is `time`."""
    columns = _ros_columns(points.columns)
    types = {name: stored_type(name, column) for name, column in columns.items()}
    fields, offset = [], 0
    for name, stored in types.items():
        number = POINT_FIELD_TYPES[stored]
        fields.append({"name": name, "offset": offset, "datatype": number, "count": 1})
        offset += np.dtype(stored).itemsize
    count = len(columns["x"])
    height, width = points.shape or (1, count)
    values = {
        "header": header(points.frame, points.stamp_ns or time_ns),
        "height": height,
        "width": width,
        "fields": fields,
        "point_step": offset,
        "row_step": offset * width,
        "data": interleave(columns, types),
        "is_dense": all(bool(np.isfinite(columns[axis]).all()) for axis in "xyz"),
    }
    return encode_ros2("sensor_msgs/PointCloud2", values)


def markers_message(boxes: Boxes, time_ns: int) -> Parts:
    """The boxes of a frame for the eye, in the place of those before."""
    markers: list[dict[str, Any]] = [{"header": header(boxes.frame, time_ns), "action": DELETE_ALL}]
    for identity, label, box in boxes.placed():
        common = {
            "header": header(box.pose.dst, time_ns),
            "id": identity,
            "action": ADD,
            "pose": ros_pose(box.pose),
        }
        cube = {
            "ns": "labels",
            "type": CUBE,
            "scale": box_size(box),
            "color": ros_colour(BOX_COLOUR),
        }
        text = {
            "ns": "names",
            "type": TEXT_VIEW_FACING,
            "scale": {"z": TEXT_M},
            "color": ros_colour(TEXT_COLOUR),
            "text": label.detection.name,
        }
        markers += [common | cube, common | text]
    return encode_ros2("visualization_msgs/MarkerArray", {"markers": markers})


def detections_message(boxes: Boxes, time_ns: int) -> Parts:
    """The boxes of a frame for programs."""
    detections = []
    for identity, label, box in boxes.placed():
        hypothesis = {"class_id": label.detection.name, "score": label.detection.score}
        pose = ros_pose(box.pose)
        detections.append(
            {
                "header": header(box.pose.dst, time_ns),
                "results": [{"hypothesis": hypothesis, "pose": {"pose": pose}}],
                "bbox": {"center": pose, "size": box_size(box)},
                "id": str(identity),
            }
        )
    values = {"header": header(boxes.frame, time_ns), "detections": detections}
    return encode_ros2("vision_msgs/Detection3DArray", values)


def header(frame: str, time_ns: int) -> dict[str, Any]:
    """`std_msgs/Header`."""
    return {"stamp": stamp(time_ns), "frame_id": frame}


def stamp(time_ns: int) -> dict[str, int]:
    """`builtin_interfaces/Time`."""
    seconds, nanoseconds = divmod(time_ns, NS_PER_S)
    return {"sec": seconds, "nanosec": nanoseconds}


def vector(xyz: AnyArray) -> dict[str, float]:
    """`geometry_msgs/Vector3` or `Point`."""
    return dict(zip("xyz", map(float, xyz), strict=True))


def quaternion(pose: Pose) -> dict[str, float]:
    """`geometry_msgs/Quaternion`."""
    return dict(zip("wxyz", quaternion_wxyz(pose.matrix[:3, :3]), strict=True))


def ros_pose(pose: Pose) -> dict[str, Any]:
    """`geometry_msgs/Pose` of `src` in `dst`."""
    return {"position": vector(pose.translation_m), "orientation": quaternion(pose)}


def _image(raster: Raster, time_ns: int) -> dict[str, Any]:
    height, width = raster.values.shape
    return {
        "header": header(raster.frame, time_ns),
        "height": height,
        "width": width,
        "encoding": raster.encoding,
        "step": width * raster.values.itemsize,
        "data": np.ascontiguousarray(raster.values).reshape(-1),
    }


def _ros_columns(columns: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Colours as one column in the place of red, and the name that drivers give to a time."""
    result: dict[str, AnyArray] = {}
    for name, column in columns.items():
        if name == COLOURS[0]:
            result["rgb"] = _packed_colours(*(columns[colour] for colour in COLOURS))
        elif name not in (*COLOURS, ALPHA):
            result[ROS_POINT_TIME if name == POINT_TIME else name] = column
    return result


def _packed_colours(red: AnyArray, green: AnyArray, blue: AnyArray) -> Float32:
    """(N,) floats of the bits 0x00RRGGBB, as PCL and RViz have it."""
    packed = np.empty((len(red), 4), np.uint8)
    packed[:, 0], packed[:, 1], packed[:, 2], packed[:, 3] = blue, green, red, 0
    return packed.reshape(-1).view("<f4")


def _median_sigma(sigma: Float32 | None) -> float:
    """Typical error of a disparity, px: ROS has one number for all of them."""
    known = np.zeros(0) if sigma is None else sigma[::8, ::8]
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) else 0.0


def box_size(box: Box3D) -> dict[str, float]:
    """`geometry_msgs/Vector3`: length, width, height."""
    return {"x": box.length_m, "y": box.width_m, "z": box.height_m}


def ros_colour(rgba: tuple[float, ...]) -> dict[str, float]:
    """`std_msgs/ColorRGBA`."""
    return dict(zip("rgba", rgba, strict=True))
