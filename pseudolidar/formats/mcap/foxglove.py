"""The Foxglove profile of recordings: protobuf messages of Foxglove's schemas."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedPointCloud_pb2 import CompressedPointCloud
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from pseudolidar.formats.mcap import channels as names
from pseudolidar.formats.mcap import meanings
from pseudolidar.formats.mcap.draco import draco_message
from pseudolidar.formats.mcap.items import (
    CameraModel,
    Disparity,
    Kind,
    Note,
    Picture,
    Raster,
    Transforms,
    Way,
)
from pseudolidar.formats.mcap.obstacle_scene import annotations_message, obstacles_message
from pseudolidar.formats.mcap.points import points_message
from pseudolidar.formats.mcap.profile import Profile, Topic
from pseudolidar.formats.mcap.protobuf import (
    PROTOBUF,
    schema_of,
    serialised,
    set_stamp,
    with_data,
)
from pseudolidar.formats.mcap.records import Parts
from pseudolidar.formats.mcap.scene import labels_message
from pseudolidar.formats.points.draco import DRACO_MEANING
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.pose import Pose as FramePose


def log_message(note: Note, timestamp_ns: int) -> Parts:
    """A line of the log."""
    message = Log(level=Log.INFO, message=note.text, name=note.name, file=note.detail)
    set_stamp(message.timestamp, timestamp_ns)
    return serialised(message)


def transforms_message(tree: Transforms, timestamp_ns: int) -> Parts | None:
    """All transforms, repeated with every frame so that seeking works."""
    message = FrameTransforms()
    for pose in (*tree.moving, *tree.fixed):
        x, y, z = pose.translation_m
        qw, qx, qy, qz = quaternion_wxyz(pose.matrix[:3, :3])
        transform = message.transforms.add(parent_frame_id=pose.dst, child_frame_id=pose.src)
        set_stamp(transform.timestamp, timestamp_ns)
        transform.translation.x, transform.translation.y, transform.translation.z = x, y, z
        rotation = transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = qx, qy, qz, qw
    return serialised(message)


def pose_message(pose: FramePose, timestamp_ns: int) -> Parts:
    """Where the body is."""
    message = PoseInFrame(frame_id=pose.dst)
    set_stamp(message.timestamp, timestamp_ns)
    _set_pose(message.pose, pose)
    return serialised(message)


def path_message(way: Way, timestamp_ns: int) -> Parts:
    """Where the body was until now; Foxglove's poses have no times of their own."""
    message = PosesInFrame(frame_id=way.poses[0].dst)
    set_stamp(message.timestamp, timestamp_ns)
    for pose in way.poses:
        _set_pose(message.poses.add(), pose)
    return serialised(message)


def _set_pose(target: PoseMessage, pose: FramePose) -> None:
    place, turn = target.position, target.orientation
    place.x, place.y, place.z = pose.translation_m
    turn.w, turn.x, turn.y, turn.z = quaternion_wxyz(pose.matrix[:3, :3])


def calibration_message(model: CameraModel, timestamp_ns: int) -> Parts:
    """A rectified camera, in its own optical frame."""
    message = CameraCalibration(
        frame_id=model.frame,
        width=model.camera.width_px,
        height=model.camera.height_px,
        distortion_model="plumb_bob",
        K=model.camera.K.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=model.P.ravel().tolist(),
    )
    set_stamp(message.timestamp, timestamp_ns)
    return serialised(message)


def picture_message(picture: Picture, timestamp_ns: int) -> Parts:
    """A JPEG or PNG."""
    message = CompressedImage(frame_id=picture.frame, format=picture.kind)
    set_stamp(message.timestamp, timestamp_ns)
    return with_data(message, picture.data)


def disparity_message(disparity: Disparity, timestamp_ns: int) -> Parts:
    """Disparity in px, 32-bit float, NaN where there is none."""
    values = disparity.disparity.values.astype("<f4", copy=False)
    return raster_message(Raster(values, "32FC1", disparity.rig.left.frame), timestamp_ns)


def raster_message(raster: Raster, timestamp_ns: int) -> Parts:
    """A raw picture."""
    height, width = raster.values.shape
    message = RawImage(
        frame_id=raster.frame,
        width=width,
        height=height,
        encoding=raster.encoding,
        step=width * raster.values.itemsize,
    )
    set_stamp(message.timestamp, timestamp_ns)
    return with_data(message, raster.values)


def _frame_name(data: bytes) -> str:
    return str(Log.FromString(data).name)


LOG = schema_of(Log)
TRANSFORMS = schema_of(FrameTransforms)
CALIBRATION = schema_of(CameraCalibration)
PICTURE = schema_of(CompressedImage)
RAW = schema_of(RawImage)
CLOUD = schema_of(PointCloud)
SCENE = schema_of(SceneUpdate)
ANNOTATIONS = schema_of(ImageAnnotations)
PACKED_CLOUD = schema_of(CompressedPointCloud)
POSE = schema_of(PoseInFrame)
POSES = schema_of(PosesInFrame)

DEPTH, CAMERA_DEPTH = meanings.DEPTH_MEANING, meanings.CAMERA_DEPTH_MEANING
CLOUDS = meanings.POINTS_MEANING
DRACO = CLOUDS | DRACO_MEANING

FOXGLOVE = Profile(
    name="foxglove",
    header="",
    encoding=PROTOBUF,
    frame_name=_frame_name,
    topics=(
        Topic(names.FRAME, Kind.MARK, LOG, log_message, meanings.MARK_MEANING),
        Topic(names.LOG, Kind.NOTE, LOG, log_message),
        Topic(names.TRANSFORMS, Kind.TRANSFORMS, TRANSFORMS, transforms_message),
        Topic("/camera/left/image", Kind.LEFT_IMAGE, PICTURE, picture_message),
        Topic("/camera/left/calibration", Kind.LEFT_CAMERA, CALIBRATION, calibration_message),
        Topic("/camera/right/image", Kind.RIGHT_IMAGE, PICTURE, picture_message),
        Topic("/camera/right/calibration", Kind.RIGHT_CAMERA, CALIBRATION, calibration_message),
        Topic(names.DISPARITY, Kind.DISPARITY, RAW, disparity_message, meanings.DISPARITY_MEANING),
        Topic(names.DEPTH, Kind.DEPTH, RAW, raster_message, DEPTH),
        Topic(names.DEPTH + "/png", Kind.DEPTH_PNG, PICTURE, picture_message, DEPTH),
        Topic(names.STEREO_POINTS, Kind.STEREO_POINTS, CLOUD, points_message, CLOUDS),
        Topic(names.SCAN, Kind.SCAN, CLOUD, points_message, meanings.SCAN_MEANING),
        Topic(names.LABELS, Kind.LABELS, SCENE, labels_message),
        Topic("/camera/image", Kind.IMAGE, PICTURE, picture_message),
        Topic("/camera/calibration", Kind.CAMERA, CALIBRATION, calibration_message),
        Topic(names.CAMERA_DEPTH, Kind.CAMERA_DEPTH, RAW, raster_message, CAMERA_DEPTH),
        Topic(
            names.CAMERA_DEPTH + "/png",
            Kind.CAMERA_DEPTH_PNG,
            PICTURE,
            picture_message,
            CAMERA_DEPTH,
        ),
        Topic(names.POINTS, Kind.POINTS, CLOUD, points_message, CLOUDS),
        Topic(
            names.STEREO_POINTS + "/draco",
            Kind.STEREO_POINTS_DRACO,
            PACKED_CLOUD,
            draco_message,
            DRACO,
        ),
        Topic(names.POINTS + "/draco", Kind.POINTS_DRACO, PACKED_CLOUD, draco_message, DRACO),
        Topic(names.OBSTACLES, Kind.OBSTACLES, SCENE, obstacles_message),
        Topic("/camera/left/annotations", Kind.OBSTACLES_SEEN, ANNOTATIONS, annotations_message),
        Topic(names.OBSTACLE_EDGES, Kind.OBSTACLE_EDGES, CLOUD, points_message),
        Topic(names.POSE, Kind.POSE, POSE, pose_message),
        Topic(names.PATH, Kind.PATH, POSES, path_message),
        Topic(names.MAP_POINTS, Kind.MAP_POINTS, CLOUD, points_message, CLOUDS),
    ),
)
