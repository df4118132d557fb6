"""Readers beside those of clouds and recordings: whole files, and what reads them."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pseudolidar.commandline.execute import _values_of
from pseudolidar.commandline.verbs import load_verb
from pseudolidar.errors import PseudolidarError
from pseudolidar.evaluation.map_files import read_map
from pseudolidar.formats.limits import DEFAULT_LIMITS
from pseudolidar.formats.onnx.model import read_onnx
from pseudolidar.formats.oxts import read_oxts
from pseudolidar.formats.pictures.depth_png import encode_depth_png, read_depth_png
from pseudolidar.formats.pictures.disparity_png import encode_disparity_png, read_disparity_png
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.formats.pictures.pfm import encode_pfm, read_pfm
from pseudolidar.formats.points.draco import encode_draco
from pseudolidar.formats.recordings.decoders import Decoder, refusal
from pseudolidar.formats.recordings.draco_cloud import draco_cloud
from pseudolidar.formats.recordings.message_store import Channel
from pseudolidar.formats.recordings.recording_store import open_store
from pseudolidar.formats.rigs.body_json import read_body, write_body
from pseudolidar.formats.rigs.camera_file import read_camera as read_one_camera
from pseudolidar.formats.rigs.k_txt import write_k_txt
from pseudolidar.formats.rigs.kalibr import write_camchain
from pseudolidar.formats.rigs.kitti import CAM_TO_CAM, encode_object_calib, write_raw_calib
from pseudolidar.formats.rigs.kitti_unrectified import read_unrectified_calib
from pseudolidar.formats.rigs.middlebury import write_middlebury_calib
from pseudolidar.formats.rigs.opencv_rig_writers import write_camera_info, write_opencv
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.rigs.rig_reading import RigReading, unchanged
from pseudolidar.formats.time_table import read_time_table
from pseudolidar.formats.timestamps import read_times, read_timestamps
from pseudolidar.formats.trajectory_file import read_trajectory
from pseudolidar.formats.tum import read_associations, read_picture_list, read_tum_trajectory
from pseudolidar.formats.video.file import VideoFile
from pseudolidar.geometry.rectification import rectification
from pseudolidar.running.journal.journal_file import first_line, read_journal
from pseudolidar.running.reports.rig_report import RigReport
from pseudolidar.running.tuning.trials import Trials
from pseudolidar.sources.recording.recording import Recording
from pseudolidar.structures.disparity import DepthMap, DisparityMap
from tests.body_rigs import body_rig
from tests.raw_rigs import raw_rig
from tests.recordings import (
    ros2_messages,
    small_drive,
    small_rig,
    write_foxglove,
    write_ros2_bag,
    write_ros2_mcap,
)
from tests.stereo.graphs import two_images
from tests.videos import pictures, write_video


@dataclass(frozen=True)
class Reader:
    """What reads a kind of file.

    Args:
        corpus: whole files.
        read: must raise a `PseudolidarError`, or return.
        file: name of the file, which some go by.
    """

    corpus: Callable[[], list[bytes]]
    read: Callable[[Path], Any]
    file: str


RIG = small_rig()
SIZE_PX = RIG.left.size_px
PLACE_M = 0.11
RAW_RIGS = (raw_rig(4), raw_rig(4, model="fisheye"))


def written(name: str, *writers: Callable[[Path], Any]) -> list[bytes]:
    """The bytes of the file that each writer writes."""
    found = []
    for write in writers:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            write(path)
            found.append(path.read_bytes())
    return found


# --- calibrations -----------------------------------------------------------------------------


def by_opencv(suffix: str) -> list[bytes]:
    """As OpenCV writes them: of rectified cameras, and of those that are not."""
    rig = small_rig()
    rectified = {"P1": rig.P_left, "P2": rig.P_right}
    raw = {"M1": rig.left.K, "M2": rig.right.K, "D1": np.zeros((1, 5)), "D2": np.zeros((1, 5))}
    raw |= {"R": np.eye(3), "T": np.array([[-0.5], [0.0], [0.0]])}

    def write(path: Path, values: dict[str, Any]) -> None:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for name, value in values.items():
            storage.write(name, value)
        storage.release()

    writers = [lambda path, v=values: write(path, v) for values in (rectified, raw)]
    return written(f"a.{suffix}", *writers)


def camera_info() -> list[bytes]:
    """Of the left eye and of the right one."""
    with tempfile.TemporaryDirectory() as folder:
        left, right = Path(folder) / "left.yaml", Path(folder) / "right.yaml"
        write_camera_info(left, right, unchanged(small_rig()))
        return [left.read_bytes(), right.read_bytes()]


def projections() -> list[bytes]:
    """Projection matrices of a pair in brackets, and in rows."""
    matrices = {"p_left": RIG.P_left, "p_right": RIG.P_right}
    named = "".join(f"{name} = {P.tolist()}\n" for name, P in matrices.items())
    rows = "".join(" ".join(map(repr, row)) + "\n" for P in matrices.values() for row in P.tolist())
    return [named.encode(), rows.encode()]


def read_camera(path: Path) -> None:
    """The left camera as it is given, beside a whole right one."""
    right = path.with_name("right.yaml")
    if not right.exists():
        right.write_bytes(camera_info()[1])
    told(read_any_rig(path.parent, size_px=SIZE_PX))


def euroc() -> list[bytes]:
    """The file of the right camera; the left one has the body's axes."""
    return [sensor_text(PLACE_M).encode()]


def sensor_text(place_m: float) -> str:
    rows = f"[1, 0, 0, {place_m}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]"
    return (
        f"# General\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: {rows}\n"
        "resolution: [752, 480]\ncamera_model: pinhole\nintrinsics: [458.5, 457.5, 367.5, 248.5]\n"
        "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28, 0.07, 0, 0]\n"
    )


def read_sensor(path: Path) -> None:
    """The right camera as it is given, beside a whole left one."""
    left = path.with_name("whole.yaml")
    if not left.exists():
        left.write_text(sensor_text(0.0))
    told(read_any_rig(f"{left},{path}"))


def read_rig(path: Path) -> None:
    told(read_any_rig(path, size_px=SIZE_PX))


def whole_errors(read: Callable[[Path], Any]) -> Callable[[Path], None]:
    """The reader; its errors say where, what, what instead, and what to do."""

    def of(path: Path) -> None:
        try:
            read(path)
        except PseudolidarError as error:
            told = error.as_dict()
            empty = [key for key in ("path", "where", "got", "want", "fix") if not told[key]]
            assert not empty, f"{empty} of {error}"  # noqa: PT017
            raise

    return of


def told(reading: RigReading) -> None:
    """What users see of a rig, and what is done with it."""
    report = RigReport(reading)
    assert report.text()
    assert report.as_dict()["form"]


def read_mounted(path: Path) -> None:
    """KITTI's cameras as they were mounted, rectified."""
    calibration = read_unrectified_calib(path)
    told(RigReading(path, "KITTI", raw=calibration.rig((0, 1))))


# --- what runs leave behind for the next one ----------------------------------------------------


def trials() -> list[bytes]:
    """The journal of a search with two trials."""
    judged = {"loss": 0.25, "density": 0.9, "d1_est": None, "d1_filled": None, "seconds": 0.125}
    lines = [{"schema": 1, "search": SEARCH}]
    lines += [{"key": f"{n:016x}", "frame": "000000", **judged, "settings": {}} for n in (1, 2)]
    return ["".join(json.dumps(line) + "\n" for line in lines).encode()]


SEARCH = {"source": "room", "matcher": "census"}


def read_trials(path: Path) -> None:
    found = Trials.opened(path, SEARCH, anew=False)
    for trial in found.known.values():
        assert trial.judgement.loss >= 0 or trial.judgement.loss < 0
        assert trial.seconds + trial.judgement.density is not None
        assert f"{trial.key:>16} {trial.frame}"


def journals() -> list[bytes]:
    """The journal of a run with two frames."""
    file = {"name": "pcd/000000.pcd", "size": 120, "crc32": 226745309}
    lines = [first_line({"source": "a", "to": "pcd"}, ("a.mcap",))]
    figures = {"files": [file], "figures": {"points": 7}, "skipped": None}
    lines += [{"id": f"{n:06d}", "index": n, **figures} for n in range(2)]
    return ["".join(json.dumps(line) + "\n" for line in lines).encode()]


def settings() -> list[bytes]:
    """The settings of a run, alone and as its run.json has them."""
    matcher = {"kind": "census", "quality": "fast", "disparities": None, "penalty_large": 95}
    given = {"to": "pcd", "matcher": matcher, "crop": None, "normals": False}
    return [json.dumps(given).encode(), json.dumps({"settings": given, "counts": {}}).encode()]


def read_settings(path: Path) -> None:
    _values_of(load_verb("convert"), path)


def kitti_raw() -> list[bytes]:
    """Of cameras as mounted."""
    with tempfile.TemporaryDirectory() as folder:
        write_raw_calib(Path(folder), RAW_RIGS[0], rectified=rectification(RAW_RIGS[0]))
        return [(Path(folder) / CAM_TO_CAM).read_bytes()]


def cameras() -> list[bytes]:
    """A single camera by its numbers, and as Open3D has it."""
    named = {"fx": 50.0, "fy": 50.5, "cx": 48.0, "cy": 32.0, "width": 96, "height": 64}
    matrix = [50.0, 0.0, 0.0, 0.0, 50.5, 0.0, 48.0, 32.0, 1.0]
    open3d = {"width": 96, "height": 64, "intrinsic_matrix": matrix}
    return [json.dumps(fields).encode() for fields in (named, open3d)]


# --- texts ------------------------------------------------------------------------------------

TIMES = [b"0.0\n0.1\n0.2\n", b"2011-09-26 13:02:44.327963904\n2011-09-26 13:02:44.431\n",
         b"1600000000000000000 a.png\n1600000000100000000 b.png\n"]  # fmt: skip
TUM = [b"# time file\n1305031102.175 rgb/a.png\n1305031102.211 rgb/b.png\n",
       b"1.0 rgb/a.png 1.01 depth/a.png\n2.0 rgb/b.png 2.01 depth/b.png\n",
       b"1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0.1 0.995\n"]  # fmt: skip
POSES = [TUM[-1], b"1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n",
         b"#timestamp [ns],x\n15,0,0,0,1,0,0,0\n25,1,0,0,1,0,0,0,9,9\n"]  # fmt: skip
OXTS = [b"49.0 8.4 116.4 0.03 0.01 -3.0 " + b" ".join([b"0.5"] * 24) + b"\n"]


def any_of(*readers: Callable[[Path], Any]) -> Callable[[Path], None]:
    """All of the readers; the error of the last one where none reads it."""

    def read(path: Path) -> None:
        errors = []
        for reader in readers:
            try:
                reader(path)
            except PseudolidarError as error:
                errors.append(error)
        if len(errors) == len(readers):
            raise errors[-1]

    return read


# --- pictures and maps ------------------------------------------------------------------------


def images() -> list[bytes]:
    rng = np.random.default_rng(6)
    smooth = cv2.resize(rng.integers(0, 256, (6, 8, 3), np.uint8), (40, 30))
    return [cv2.imencode(f".{form}", smooth)[1].tobytes() for form in ("png", "jpg", "tiff", "ppm")]


def maps() -> tuple[DisparityMap, DepthMap]:
    values = np.random.default_rng(7).uniform(1, 60, (11, 13)).astype(np.float32)
    values[2] = np.nan
    return DisparityMap(values), DepthMap(values)


def npy() -> list[bytes]:
    arrays = (maps()[0].values, np.arange(6, dtype=np.uint16).reshape(2, 3))
    return written("a.npy", *(partial(np.save, arr=values) for values in arrays))


# --- recordings -------------------------------------------------------------------------------


def bag(path: Path) -> None:
    """A ROS 2 bag of one frame; its data base alone."""
    folder = path.parent / "bag"
    write_ros2_bag(folder, ros2_messages(small_drive(1, grey=True)))
    (data,) = folder.glob("*.db3")
    path.write_bytes(data.read_bytes())


def bag1(path: Path) -> None:
    """A ROS 1 bag with one text and one transform."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](1, 2)
    header = types["std_msgs/msg/Header"](0, stamp, "velodyne")
    field = types["sensor_msgs/msg/PointField"]
    fields = [field(axis, 4 * i, 7, 1) for i, axis in enumerate("xyz")]
    values = np.arange(30, dtype="<f4").tobytes()
    kind = "sensor_msgs/msg/PointCloud2"
    cloud = types[kind](
        header, 1, 10, fields, False, 12, 120, np.frombuffer(values, np.uint8), True
    )
    with Writer(path) as writer:
        topic = writer.add_connection("/points", kind, typestore=store)
        for index in range(3):
            writer.write(topic, 10**9 * (index + 1), store.serialize_ros1(cloud, kind))


@cache
def messages() -> tuple[list[bytes], list[Channel]]:
    """Messages without their recording: a byte for the channel, and the message; the channels."""
    corpus: list[bytes] = []
    channels: list[Channel] = []
    drive = small_drive(1, grey=True)
    with tempfile.TemporaryDirectory() as folder:
        ros, fox = Path(folder) / "ros.mcap", Path(folder) / "fox.mcap"
        write_ros2_mcap(ros, ros2_messages(drive, raw=True))
        write_foxglove(fox, drive)
        for path in (ros, fox):
            store = open_store(path)
            for number, channel in enumerate(store.channels):
                if not refusal(channel):
                    (data,) = store.read([(number, 0)])
                    corpus.append(bytes([len(channels)]) + bytes(data))
                    channels.append(channel)
    return corpus, channels


def read_message(path: Path) -> None:
    channels = messages()[1]
    data = path.read_bytes() or bytes(1)
    Decoder(channels[data[0] % len(channels)])(data[1:])


def read_recording(path: Path) -> None:
    source = Recording(str(path)).open()
    for index in range(len(source.ids)):
        try:
            source.load(index)
        except PseudolidarError:
            continue


def draco() -> list[bytes]:
    rng = np.random.default_rng(8)
    columns = {axis: rng.uniform(-9, 9, 30).astype(np.float32) for axis in "xyz"}
    return [encode_draco(columns), encode_draco(columns | {"ring": np.arange(30, dtype=np.uint8)})]


def read_draco(path: Path) -> None:
    draco_cloud(path.read_bytes(), "velodyne", 0, own=False, limits=DEFAULT_LIMITS)


def videos() -> list[bytes]:
    shown = pictures(4)
    encode = partial(write_video, frames=shown, rate=Fraction(10))
    return [*written("a.mkv", encode), *written("a.avi", encode)]


def read_video(path: Path) -> None:
    video = VideoFile.open(path)
    for number in range(len(video)):
        try:
            video.picture(number)
        except PseudolidarError:
            continue


def _rig(name: str, *writers: Callable[[Path], Any]) -> Reader:
    return Reader(lambda: written(name, *writers), whole_errors(read_rig), name)


READERS = {
    "rig-yaml": Reader(
        lambda: by_opencv("yml") + written("a.yml", partial(write_opencv, rig=RIG)),
        whole_errors(read_rig),
        "a.yml",
    ),
    "rig-xml": Reader(lambda: by_opencv("xml"), whole_errors(read_rig), "a.xml"),
    "rig-json": Reader(
        lambda: (
            by_opencv("json")
            + written("a.json", *(partial(write_rig, rig=rig) for rig in (RIG, *RAW_RIGS)))
        ),
        whole_errors(read_rig),
        "a.json",
    ),
    "rig-body": Reader(
        lambda: written("a.json", partial(write_body, body=body_rig())),
        whole_errors(read_body),
        "a.json",
    ),
    "camera-info": Reader(lambda: camera_info()[:1], whole_errors(read_camera), "left.yaml"),
    "k-txt": _rig("K.txt", partial(write_k_txt, rig=RIG)),
    "middlebury": _rig("calib.txt", partial(write_middlebury_calib, rig=RIG, ndisp=33)),
    "kitti-calib": Reader(lambda: [encode_object_calib(RIG)], whole_errors(read_rig), "000000.txt"),
    "kalibr": Reader(
        lambda: written("camchain.yaml", *(partial(write_camchain, rig=rig) for rig in RAW_RIGS)),
        whole_errors(read_rig),
        "camchain.yaml",
    ),
    "projections": Reader(projections, whole_errors(read_rig), "camera_data.txt"),
    "euroc": Reader(euroc, whole_errors(read_sensor), "sensor.yaml"),
    "kitti-bare": Reader(lambda: projections()[1:], whole_errors(read_rig), "calib.txt"),
    "kitti-raw": Reader(kitti_raw, whole_errors(read_rig), "calib_cam_to_cam.txt"),
    "kitti-mounted": Reader(kitti_raw, whole_errors(read_mounted), "calib_cam_to_cam.txt"),
    "camera": Reader(cameras, partial(read_one_camera, size_px=SIZE_PX), "intrinsics.json"),
    "trials": Reader(trials, read_trials, "trials.jsonl"),
    "journal": Reader(journals, read_journal, "journal.jsonl"),
    "settings": Reader(settings, read_settings, "run.json"),
    "times": Reader(
        lambda: TIMES, any_of(read_timestamps, read_times, read_time_table), "times.txt"
    ),
    "tum": Reader(
        lambda: TUM,
        any_of(read_picture_list, read_associations, read_tum_trajectory),
        "rgb.txt",
    ),
    "trajectory": Reader(lambda: POSES, read_trajectory, "a.txt"),
    "oxts": Reader(lambda: OXTS, read_oxts, "0.txt"),
    "picture": Reader(images, read_image, "input"),
    "disparity-png": Reader(lambda: [encode_disparity_png(maps()[0])], read_disparity_png, "a.png"),
    "depth-png": Reader(lambda: [encode_depth_png(maps()[1])], read_depth_png, "a.png"),
    "pfm": Reader(lambda: [encode_pfm(maps()[0])], read_pfm, "a.pfm"),
    "npy": Reader(npy, read_map, "a.npy"),
    "onnx": Reader(lambda: written("a.onnx", two_images), read_onnx, "a.onnx"),
    "messages": Reader(lambda: messages()[0], read_message, "message"),
    "bag2": Reader(lambda: written("a.db3", bag), read_recording, "a.db3"),
    "bag1": Reader(lambda: written("a.bag", bag1), read_recording, "a.bag"),
    "draco": Reader(draco, read_draco, "a.drc"),
    "video": Reader(videos, read_video, "a.mkv"),
}
