"""Recordings as other programs write them: ROS 2 bags by rosbags, MCAP by its own writers."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud as PointCloudMessage
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pseudolidar.formats.mcap.content import McapContent
from pseudolidar.formats.mcap.frame import pack_frame
from pseudolidar.formats.mcap.log import McapLog
from pseudolidar.formats.mcap.messages import frame_messages
from pseudolidar.formats.mcap.prolog import describe_recording
from pseudolidar.formats.mcap.protobuf import set_stamp
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.rigs.rig_json import rig_text
from pseudolidar.geometry.frames import R_BODY_OPTICAL, frame_tree
from pseudolidar.geometry.quaternion import quaternion_wxyz, rotation_of
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame, RecordedCloud

ROS = get_typestore(Stores.ROS2_HUMBLE)
TYPES = ROS.types
LEFT, RIGHT = "left_optical", "right_optical"
NAMES = {"camera_left": LEFT, "camera_right": RIGHT, "velodyne": "velo_link"}
POINT_TYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
# Bags file messages when they arrive, a little after their stamps.
DELAY_NS = 3_000_000


def stamp(time_ns: int) -> Any:
    return TYPES["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)


def header(time_ns: int, frame: str) -> Any:
    return TYPES["std_msgs/msg/Header"](stamp(time_ns), frame)


def ros_image(pixels: np.ndarray, time_ns: int, frame: str, encoding: str) -> Any:
    data = np.ascontiguousarray(pixels)
    return TYPES["sensor_msgs/msg/Image"](
        header(time_ns, frame),
        data.shape[0],
        data.shape[1],
        encoding,
        0,
        data.strides[0],
        data.reshape(-1).view(np.uint8),
    )


def ros_compressed(data: bytes, time_ns: int, frame: str, kind: str = "png") -> Any:
    message = TYPES["sensor_msgs/msg/CompressedImage"]
    return message(header(time_ns, frame), kind, np.frombuffer(data, np.uint8))


def ros_camera(
    K: np.ndarray,
    P: np.ndarray,
    size: tuple[int, int],
    time_ns: int,
    frame: str,
    D: Sequence[float] = (0.0,) * 5,
) -> Any:
    roi = TYPES["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return TYPES["sensor_msgs/msg/CameraInfo"](
        header(time_ns, frame),
        size[1],
        size[0],
        "plumb_bob",
        np.array(D, np.float64),
        K.ravel().astype(np.float64),
        np.eye(3).ravel(),
        P.ravel().astype(np.float64),
        0,
        0,
        roi,
    )


def ros_cloud(
    records: np.ndarray,
    time_ns: int,
    frame: str,
    *,
    shape: tuple[int, int] | None = None,
    row_padding: int = 0,
    big_endian: bool = False,
    fields: Iterable[Any] | None = None,
) -> Any:
    """A PointCloud2 of a structured array; its gaps are the padding."""
    height, width = shape or (1, len(records))
    dtype = records.dtype
    if fields is None:
        fields = []
        for name in dtype.names or ():
            base, offset = dtype.fields[name][:2]
            kind, count = base.subdtype or (base, (1,))
            point_field = TYPES["sensor_msgs/msg/PointField"]
            fields.append(point_field(name, offset, POINT_TYPES[kind.str[1:]], count[0]))
    data = np.ascontiguousarray(records).view(np.uint8).reshape(height, -1)
    data = np.pad(data, ((0, 0), (0, row_padding)))
    return TYPES["sensor_msgs/msg/PointCloud2"](
        header(time_ns, frame),
        height,
        width,
        list(fields),
        big_endian,
        dtype.itemsize,
        data.shape[1],
        data.reshape(-1),
        bool(np.isfinite(records["x"]).all()) if len(records) else True,
    )


def ros_transforms(poses: Iterable[Pose], time_ns: int) -> Any:
    found = []
    for pose in poses:
        w, x, y, z = quaternion_wxyz(pose.matrix[:3, :3])
        transform = TYPES["geometry_msgs/msg/Transform"](
            TYPES["geometry_msgs/msg/Vector3"](*pose.translation_m),
            TYPES["geometry_msgs/msg/Quaternion"](x, y, z, w),
        )
        parent, child = (NAMES.get(name, name) for name in (pose.dst, pose.src))
        stamped = TYPES["geometry_msgs/msg/TransformStamped"]
        found.append(stamped(header(time_ns, parent), child, transform))
    return TYPES["tf2_msgs/msg/TFMessage"](found)


def scan_records(scan: LidarScan) -> np.ndarray:
    """A Velodyne's records with gaps, as drivers write them."""
    dtype = np.dtype(
        {
            "names": ["x", "y", "z", "intensity"],
            "formats": ["<f4"] * 4,
            "offsets": [0, 4, 8, 16],
            "itemsize": 32,
        }
    )
    records = np.zeros(len(scan), dtype)
    for axis, name in enumerate("xyz"):
        records[name] = scan.xyz[:, axis]
    records["intensity"] = scan.reflectance
    return records


def ros2_messages(
    frames: Iterable[StereoFrame], *, raw: bool = False
) -> Iterator[tuple[str, Any, int]]:
    """(topic, message, file time) of a drive, as a car would record it."""
    for number, frame in enumerate(frames):
        time_ns, rig = frame.timestamp_ns, frame.rig
        filed_ns = time_ns + DELAY_NS
        moving = [pose for pose in frame_tree(rig, frame.pose) if pose.src == "base_link"]
        fixed = [pose for pose in frame_tree(rig, frame.pose) if pose.src != "base_link"]
        if number == 0:
            yield "/tf_static", ros_transforms(fixed, time_ns), filed_ns
        yield "/tf", ros_transforms(moving, time_ns), filed_ns
        eyes = (("left", LEFT, frame.left, rig.P_left), ("right", RIGHT, frame.right, rig.P_right))
        for side, name, pixels, P in eyes:
            place = f"/stereo/{side}"
            info = ros_camera(rig.left.K, P, rig.left.size_px, time_ns, name)
            yield f"{place}/camera_info", info, filed_ns
            if raw:
                encoding = "mono8" if pixels.ndim == 2 else "rgb8"
                yield f"{place}/image_rect", ros_image(pixels, time_ns, name, encoding), filed_ns
            else:
                packed = ros_compressed(encode_png(pixels), time_ns, name)
                yield f"{place}/image_rect/compressed", packed, filed_ns
        if frame.scan is not None:
            cloud = ros_cloud(scan_records(frame.scan), frame.scan.timestamp_ns, "velo_link")
            yield "/velodyne_points", cloud, filed_ns


def write_ros2_bag(
    folder: Path, messages: Iterable[tuple[str, Any, int]], storage: str = "sqlite3"
) -> Path:
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Rosbag2Writer(folder, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, message, filed_ns in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS)
            writer.write(connections[topic], filed_ns, ROS.serialize_cdr(message, kind))
    return folder


def write_ros1_bag(path: Path, messages: Iterable[tuple[str, Any, int]]) -> Path:
    """By rosbags, in several chunks even of a small drive."""
    store = get_typestore(Stores.ROS1_NOETIC)
    transforms = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(transforms, "tf2_msgs/msg/TFMessage"))
    writer = Rosbag1Writer(path)
    writer.set_compression(Rosbag1Writer.CompressionFormat.LZ4)
    writer.chunk_threshold = 30_000
    with writer:
        topics: dict[str, Any] = {}
        for number, (topic, message, filed_ns) in enumerate(messages):
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            data = store.serialize_ros1(_ros1(message, store.types, number), kind)
            writer.write(topics[topic], filed_ns, data)
    return path


def _ros1(message: Any, types: Any, number: int) -> Any:
    """The message with headers of ROS 1, which count, and capital letters in camera_info."""
    kind = getattr(message, "__msgtype__", None)
    if isinstance(message, list):
        return [_ros1(item, types, number) for item in message]
    if kind is None:
        return message
    values = {
        name: _ros1(getattr(message, name), types, number)
        for name in message.__dataclass_fields__
        if name != "__msgtype__"
    }
    if kind == "std_msgs/msg/Header":
        values = {"seq": number, **values}
    if kind == "sensor_msgs/msg/CameraInfo":
        values = {n.upper() if n in "dkrp" else n: v for n, v in values.items()}
    return types[kind](**values)


# --- a small drive --------------------------------------------------------------------------

WIDTH_PX, HEIGHT_PX, SHIFT_PX = 96, 48, 9
START_NS, PERIOD_NS = 1_600_000_000_000_000_000, 100_000_000


def small_rig() -> StereoRig:
    K = np.array([[80.0, 0.0, 47.5], [0.0, 80.0, 23.5], [0.0, 0.0, 1.0]])
    T_right_left = Pose.from_rotation(
        "camera_right", "camera_left", np.eye(3), np.array([-0.5, 0.0, 0.0])
    )
    T_left_velodyne = Pose.from_rotation(
        "camera_left", "velodyne", R_BODY_OPTICAL.T, np.array([0.1, -0.2, 0.3])
    )
    left, right = (Camera(K, WIDTH_PX, HEIGHT_PX, frame=f"camera_{s}") for s in ("left", "right"))
    return StereoRig(left, right, T_right_left, T_left_velodyne=T_left_velodyne)


def small_drive(frames: int = 4, *, grey: bool = False) -> list[StereoFrame]:
    """Pairs of a known disparity with scans and poses: 1 m ahead and a little turned a frame."""
    rng = np.random.default_rng(11)
    rig, drive = small_rig(), []
    for index in range(frames):
        shape = (HEIGHT_PX, WIDTH_PX + SHIFT_PX) + (() if grey else (3,))
        wide = rng.integers(0, 256, shape, np.uint8)
        turn = rotation_of(np.array([np.cos(0.01 * index), 0.0, 0.0, np.sin(0.01 * index)]))
        pose = Pose.from_rotation("map", "base_link", turn, np.array([float(index), 0.0, 0.0]))
        time_ns = START_NS + index * PERIOD_NS
        xyz = rng.normal(size=(50, 3)).astype(np.float32) * 10
        scan = LidarScan(xyz, rng.random(50, np.float32), time_ns + 7_000_000)
        drive.append(
            StereoFrame(
                wide[:, :-SHIFT_PX].copy(),
                wide[:, SHIFT_PX:].copy(),
                rig,
                f"{index:06d}",
                index,
                time_ns,
                scan=scan,
                pose=pose,
            )
        )
    return drive


# --- MCAP by its own writer -----------------------------------------------------------------


def write_ros2_mcap(path: Path, messages: Iterable[tuple[str, Any, int]]) -> Path:
    """By mcap-ros2-support, with the definitions of rosbags."""
    from mcap_ros2.writer import Writer as Ros2Writer

    with path.open("wb") as file:
        writer = Ros2Writer(file)
        schemas: dict[str, Any] = {}
        for topic, message, filed_ns in messages:
            kind = message.__msgtype__
            if kind not in schemas:
                text, _ = ROS.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_msgdef(kind, text)
            writer.write_message(topic, schemas[kind], plain(message), filed_ns, filed_ns)
        writer.finish()
    return path


def plain(message: Any) -> Any:
    """A message of rosbags as mcap-ros2-support takes them."""
    if isinstance(message, np.ndarray):
        return message.tobytes() if message.dtype == np.uint8 else message.tolist()
    if isinstance(message, list):
        return [plain(item) for item in message]
    if hasattr(message, "__dataclass_fields__"):
        names = (n for n in message.__dataclass_fields__ if n != "__msgtype__")
        return {name: plain(getattr(message, name)) for name in names}
    return message


class FoxgloveWriter:
    """Foxglove messages in an MCAP, as protobuf or as JSON, by mcap's own writer."""

    def __init__(self, path: Path, *, encoding: str = "protobuf", **settings: Any) -> None:
        self._file = path.open("wb")
        self._writer = Writer(self._file, **settings)
        self._writer.start(profile="", library="another program")
        self._encoding = encoding
        self._channels: dict[str, int] = {}

    def __enter__(self) -> FoxgloveWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self._writer.finish()
        self._file.close()

    def write(self, topic: str, message: Any, filed_ns: int) -> None:
        data = self._data(message)
        self.write_bytes(topic, message.DESCRIPTOR.full_name, self._schema(message), data, filed_ns)

    def write_bytes(
        self,
        topic: str,
        schema: str,
        definition: bytes,
        data: bytes,
        filed_ns: int,
        *,
        encoding: str | None = None,
        schema_encoding: str | None = None,
    ) -> None:
        encoding = encoding or self._encoding
        if topic not in self._channels:
            form = "protobuf" if encoding == "protobuf" else "jsonschema"
            number = self._writer.register_schema(schema, schema_encoding or form, definition)
            self._channels[topic] = self._writer.register_channel(topic, encoding, number)
        self._writer.add_message(self._channels[topic], filed_ns, data, filed_ns)

    def _schema(self, message: Any) -> bytes:
        if self._encoding == "protobuf":
            return build_file_descriptor_set(type(message)).SerializeToString()
        return b'{"type": "object"}'

    def _data(self, message: Any) -> bytes:
        if self._encoding == "protobuf":
            return message.SerializeToString()
        return json.dumps(as_json(message)).encode()


def as_json(message: Any) -> Any:
    """A message as Foxglove's JSON has it: numbers for enumerations, base64, sec and nsec."""
    if message.DESCRIPTOR.full_name == "google.protobuf.Timestamp":
        return {"sec": message.seconds, "nsec": message.nanos}
    found: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.message_type is not None:
            many = field.is_repeated
            found[field.name] = [as_json(item) for item in value] if many else as_json(value)
        elif isinstance(value, bytes):
            found[field.name] = base64.b64encode(value).decode()
        else:
            found[field.name] = list(value) if field.is_repeated else value
    return found


def foxglove_messages(frames: Iterable[StereoFrame]) -> Iterator[tuple[str, Any, int]]:
    """(topic, message, file time) of a drive as Foxglove messages of another program."""
    for frame in frames:
        time_ns, rig = frame.timestamp_ns, frame.rig
        yield "/tf", fox_transforms(frame_tree(rig, frame.pose), time_ns), time_ns + DELAY_NS
        eyes = (("left", frame.left, rig.P_left), ("right", frame.right, rig.P_right))
        for side, pixels, P in eyes:
            name = NAMES[f"camera_{side}"]
            camera = CameraCalibration(
                frame_id=name,
                width=rig.left.width_px,
                height=rig.left.height_px,
                K=rig.left.K.ravel(),
                R=np.eye(3).ravel(),
                P=P.ravel(),
            )
            image = CompressedImage(frame_id=name, format="png", data=encode_png(pixels))
            for topic, message in ((f"/{side}/calibration", camera), (f"/{side}/image", image)):
                set_stamp(message.timestamp, time_ns)
                yield topic, message, time_ns + DELAY_NS
        if frame.scan is not None:
            records = scan_records(frame.scan)
            yield "/lidar", fox_cloud(records, frame.scan.timestamp_ns), time_ns + DELAY_NS


FOX_TYPES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}


def fox_cloud(records: np.ndarray, time_ns: int, frame: str = "velo_link") -> PointCloudMessage:
    message = PointCloudMessage(frame_id=frame, point_stride=records.dtype.itemsize)
    set_stamp(message.timestamp, time_ns)
    message.pose.orientation.w = 1.0
    for name in records.dtype.names or ():
        kind, offset = records.dtype.fields[name][:2]
        message.fields.add(name=name, offset=offset, type=FOX_TYPES[kind.str[1:]])
    message.data = records.tobytes()
    return message


def fox_transforms(poses: Iterable[Pose], time_ns: int) -> FrameTransforms:
    message = FrameTransforms()
    for pose in poses:
        w, x, y, z = quaternion_wxyz(pose.matrix[:3, :3])
        parent, child = (NAMES.get(name, name) for name in (pose.dst, pose.src))
        part = message.transforms.add(parent_frame_id=parent, child_frame_id=child)
        set_stamp(part.timestamp, time_ns)
        part.translation.x, part.translation.y, part.translation.z = pose.translation_m
        part.rotation.x, part.rotation.y, part.rotation.z, part.rotation.w = x, y, z, w
    return message


def write_foxglove(
    path: Path, frames: Iterable[StereoFrame], *, encoding: str = "protobuf", **settings: Any
) -> Path:
    with FoxgloveWriter(path, encoding=encoding, **settings) as writer:
        for topic, message, filed_ns in foxglove_messages(frames):
            writer.write(topic, message, filed_ns)
    return path


# --- recordings of this package -------------------------------------------------------------


def write_own(path: Path, frames: Sequence[Frame], **content: object) -> Path:
    settings = McapContent(**content)  # type: ignore[arg-type]
    prolog = describe_recording(
        version="0",
        settings="{}",
        calibration=rig_text(frames[0].rig) if isinstance(frames[0], StereoFrame) else "",
        matcher="none",
        source="test",
        content=settings,
    )
    with McapLog(path, prolog) as log:
        for frame in frames:
            messages = frame_messages(frame, content=settings)
            log.append(pack_frame(messages, index=frame.index, compression=settings.compression))
    return path


def named_clouds(names: list[str], points: int = 40) -> list[RecordedCloud]:
    rng = np.random.default_rng(5)
    frames = []
    for index, name in enumerate(names):
        time_ns = START_NS + index * PERIOD_NS
        cloud = PointCloud(
            rng.normal(size=(points, 3)).astype(np.float32),
            "velodyne",
            time_ns,
            rgb=rng.integers(0, 256, (points, 3), np.uint8),
            intensity=rng.random(points, np.float32),
            extra={
                "ring": rng.integers(0, 64, points).astype(np.uint16),
                "id": rng.integers(-(2**40), 2**40, points),
                "flag": rng.random(points) > 0.5,
            },
        )
        frames.append(RecordedCloud(cloud, name, index, time_ns))
    return frames
