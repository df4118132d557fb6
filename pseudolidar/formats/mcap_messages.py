"""Frames as messages: pure functions from nouns to serialised Foxglove protobuf."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from pseudolidar.errors import StructureError
from pseudolidar.formats import mcap_channels as channels
from pseudolidar.formats.image import encode_jpeg, encode_png
from pseudolidar.formats.mcap_content import DEFAULT_CONTENT, McapContent
from pseudolidar.formats.mcap_points import cloud_message, scan_message
from pseudolidar.formats.mcap_protobuf import Parts, serialised, set_stamp, with_data
from pseudolidar.formats.mcap_scene import labels_message
from pseudolidar.geometry.frames import MAP, frame_tree
from pseudolidar.geometry.quaternion import quaternion_wxyz
from pseudolidar.structures.arrays import AnyArray, Float64, Image
from pseudolidar.structures.camera import Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

MM_PER_M = 1000.0
# Largest depth of a 16-bit image; a depth that rounds to more is left out, not cut.
FARTHEST_MM = 65535.0


@dataclass(frozen=True)
class LogMessage:
    """One message of a recording.

    Args:
        topic: one of `mcap_channels.TOPICS`.
        timestamp_ns: time it is filed under: that of its frame.
        parts: serialised message of the topic's schema, in pieces.
    """

    topic: str
    timestamp_ns: int
    parts: Parts

    @property
    def nbytes(self) -> int:
        """Size of the message."""
        return sum(len(part) for part in self.parts)


def frame_messages(
    frame: StereoFrame,
    *,
    disparity: DisparityMap | None = None,
    depth: DepthMap | None = None,
    cloud: PointCloud | None = None,
    notes: Sequence[str] = (),
    content: McapContent = DEFAULT_CONTENT,
) -> tuple[LogMessage, ...]:
    """Everything a recording holds of a frame; pure, for worker threads.

    Args:
        frame: the pair; its scan, labels and pose are written where it has them, a scan only
            where it is calibrated to the cameras.
        disparity: of the left image.
        depth: of the left image.
        cloud: stereo cloud, in any frame of the rig.
        notes: lines for the log, besides those of the frame.
        content: what to write, and how.

    Raises:
        SequenceTime: the frame's time stamp is not positive.
        StructureError: a column of the cloud is not one number a point, or the cloud is in a frame
            that the rig does not have.
    """
    tree = frame_tree(frame.rig, frame.pose)
    notes = (*frame.notes, *notes)
    known = {MAP, *(pose.src for pose in tree)}
    if cloud is not None and cloud.frame not in known:
        raise StructureError(
            f"a cloud in frame {cloud.frame!r}", want=f"one of {', '.join(sorted(known))}"
        )
    topics = (
        *_frame_topics(frame, notes, tree),
        *_picture_topics(frame, content),
        *_known_topics(frame, content, known),
        *_result_topics(frame, disparity, depth, cloud, content),
    )
    return tuple(LogMessage(topic, frame.timestamp_ns, parts) for topic, parts in topics)


def _frame_topics(
    frame: StereoFrame, notes: Iterable[str], tree: Iterable[Pose]
) -> Iterator[tuple[str, Parts]]:
    time_ns = frame.timestamp_ns
    yield channels.FRAME, log_message(_marker_text(frame), time_ns, name=frame.id)
    for note in notes:
        yield channels.LOG, log_message(note, time_ns, name=frame.id)
    yield channels.TRANSFORMS, transforms_message(tree, time_ns)


def _picture_topics(frame: StereoFrame, content: McapContent) -> Iterator[tuple[str, Parts]]:
    rig, time_ns = frame.rig, frame.timestamp_ns
    left, right = rig.left.frame, rig.T_right_left.dst
    yield channels.LEFT_CALIBRATION, calibration_message(rig.left, rig.P_left, left, time_ns)
    yield channels.RIGHT_CALIBRATION, calibration_message(rig.right, rig.P_right, right, time_ns)
    if content.images != "none":
        yield channels.LEFT_IMAGE, picture_message(frame.left, left, time_ns, content)
        yield channels.RIGHT_IMAGE, picture_message(frame.right, right, time_ns, content)


def _known_topics(
    frame: StereoFrame, content: McapContent, known: Set[str]
) -> Iterator[tuple[str, Parts]]:
    """Scan and boxes of the data set; viewers cannot place those in a frame outside the tree."""
    time_ns, scan, labels = frame.timestamp_ns, frame.scan, frame.labels
    if content.scan and scan is not None:
        if scan.frame in known:
            yield channels.SCAN, scan_message(scan, time_ns)
        else:
            text = f"scan left out: {scan.frame} is not calibrated to the cameras"
            yield channels.LOG, log_message(text, time_ns, name=frame.id)
    if content.labels and labels is not None:
        placed = [label for label in labels if label.box is None or label.box.pose.dst in known]
        yield channels.LABELS, labels_message(placed, time_ns)


def _result_topics(
    frame: StereoFrame,
    disparity: DisparityMap | None,
    depth: DepthMap | None,
    cloud: PointCloud | None,
    content: McapContent,
) -> Iterator[tuple[str, Parts]]:
    name, time_ns = frame.rig.left.frame, frame.timestamp_ns
    if content.disparity and disparity is not None:
        yield channels.DISPARITY, disparity_message(disparity, name, time_ns)
    if content.depth == "raw" and depth is not None:
        yield channels.DEPTH, depth_message(depth, name, time_ns)
    if content.depth == "png" and depth is not None:
        yield channels.DEPTH_PNG, depth_png_message(depth, name, time_ns)
    if content.cloud and cloud is not None:
        yield channels.POINTS, cloud_message(cloud, time_ns, pixels=content.pixels)


def _marker_text(frame: StereoFrame) -> str:
    text = f"frame {frame.id}, index {frame.index}"
    return text if frame.pose else text + ", no pose: map, odom and base_link coincide"


def log_message(text: str, timestamp_ns: int, *, name: str = "") -> Parts:
    """A line of the log; `name` says of what."""
    message = Log(level=Log.INFO, message=text, name=name)
    set_stamp(message.timestamp, timestamp_ns)
    return serialised(message)


def transforms_message(tree: Iterable[Pose], timestamp_ns: int) -> Parts:
    """Transforms `T_parent_child`, repeated with every frame so that seeking works."""
    message = FrameTransforms()
    for pose in tree:
        x, y, z = pose.translation_m
        qw, qx, qy, qz = quaternion_wxyz(pose.matrix[:3, :3])
        transform = message.transforms.add(parent_frame_id=pose.dst, child_frame_id=pose.src)
        set_stamp(transform.timestamp, timestamp_ns)
        transform.translation.x, transform.translation.y, transform.translation.z = x, y, z
        rotation = transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = qx, qy, qz, qw
    return serialised(message)


def calibration_message(camera: Camera, P: Float64, frame: str, timestamp_ns: int) -> Parts:
    """A rectified camera.

    Args:
        camera: intrinsics and size.
        P: (3, 4) projection of points in the left camera's frame; `P[0, 3] = -f B` for the right.
        frame: name of the camera's optical frame.
        timestamp_ns: stamp of the image.
    """
    message = CameraCalibration(
        frame_id=frame,
        width=camera.width_px,
        height=camera.height_px,
        distortion_model="plumb_bob",
        K=camera.K.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=P.ravel().tolist(),
    )
    set_stamp(message.timestamp, timestamp_ns)
    return serialised(message)


def picture_message(image: Image, frame: str, timestamp_ns: int, content: McapContent) -> Parts:
    """An image as JPEG or PNG; 16-bit images keep their values in a PNG."""
    if content.images == "jpeg" and image.dtype == np.uint8:
        data = encode_jpeg(image, content.jpeg_quality)
        return compressed_image_message(data, "jpeg", frame, timestamp_ns)
    return compressed_image_message(encode_png(image), "png", frame, timestamp_ns)


def compressed_image_message(data: bytes, kind: str, frame: str, timestamp_ns: int) -> Parts:
    """Encoded bytes of a picture; `kind` is `jpeg` or `png`."""
    message = CompressedImage(frame_id=frame, format=kind)
    set_stamp(message.timestamp, timestamp_ns)
    return with_data(message, data)


def disparity_message(disparity: DisparityMap, frame: str, timestamp_ns: int) -> Parts:
    """Disparity in px, 32-bit float, NaN where there is none."""
    return _raw_image(disparity.values.astype("<f4", copy=False), "32FC1", frame, timestamp_ns)


def depth_message(depth: DepthMap, frame: str, timestamp_ns: int) -> Parts:
    """Depth in mm, 16 bits, as ROS REP-118 has it."""
    return _raw_image(depth_mm(depth), "16UC1", frame, timestamp_ns)


def depth_png_message(depth: DepthMap, frame: str, timestamp_ns: int) -> Parts:
    """Depth in mm as a 16-bit PNG."""
    return compressed_image_message(
        encode_png(depth_mm(depth).astype(np.uint16)), "png", frame, timestamp_ns
    )


def depth_mm(depth: DepthMap) -> Image:
    """(H, W) uint16 mm, 0 where there is none or it is beyond 65.535 m."""
    mm = np.rint(depth.values * np.float32(MM_PER_M))
    inside = (mm > 0) & (mm <= FARTHEST_MM)  # False for NaN
    return np.where(inside, mm, 0).astype("<u2")


def _raw_image(values: AnyArray, encoding: str, frame: str, timestamp_ns: int) -> Parts:
    height, width = values.shape
    message = RawImage(
        frame_id=frame,
        width=width,
        height=height,
        encoding=encoding,
        step=width * values.itemsize,
    )
    set_stamp(message.timestamp, timestamp_ns)
    return with_data(message, values)
