"""What a user would write: read, match, reproject, write, one frame after the other.

    python tests/benchmarks/plain_script.py DRIVE OUT

The same outputs as `pseudolidar convert DRIVE OUT --to pcd,mcap`, by the libraries that one finds
first: cv2 SGBM 3-way on all cores, numpy, open3d's PCD writer, mcap's protobuf writer. It is the
baseline of `conversion.py` and part of nothing else.
"""

from __future__ import annotations

import ctypes
import sys
import time
from pathlib import Path

import cv2
import libusb_package
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType
from mcap_protobuf.writer import Writer

ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
import open3d as o3d  # noqa: E402  needs libusb loaded before

FOCAL_PX, CX, CY, BASELINE_M = 721.5377, 609.5593, 172.854, 0.53273
DISPARITIES, BLOCK = 128, 5
MAX_RANGE_M = 80.0


def stamp(timestamp_ns: int) -> Timestamp:
    """Nanoseconds as protobuf has them."""
    return Timestamp(seconds=timestamp_ns // 10**9, nanos=timestamp_ns % 10**9)


def cloud_message(xyz: np.ndarray, rgb: np.ndarray, when: Timestamp) -> PointCloud:
    """Packed x, y, z, red, green, blue, alpha."""
    kinds = [(name, "<f4") for name in "xyz"] + [(c, "u1") for c in ("r", "g", "b", "a")]
    records = np.empty(len(xyz), kinds)
    for column, name in enumerate("xyz"):
        records[name] = xyz[:, column]
    for column, name in enumerate("rgb"):
        records[name] = rgb[:, column]
    records["a"] = 255
    message = PointCloud(timestamp=when, frame_id="camera_left", point_stride=records.itemsize)
    message.pose.orientation.w = 1
    names = ("x", "y", "z", "red", "green", "blue", "alpha")
    for name, (dtype, offset) in zip(names, records.dtype.fields.values(), strict=True):
        kind = PackedElementField.FLOAT32 if dtype == np.float32 else PackedElementField.UINT8
        message.fields.add(name=name, offset=offset, type=kind)
    message.data = records.tobytes()
    return message


def convert(drive: Path, out: Path) -> tuple[int, float]:
    """Convert a KITTI raw drive; frames, and seconds after the libraries were loaded."""
    (out / "pcd").mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    area = BLOCK * BLOCK
    matcher = cv2.StereoSGBM.create(
        0,
        DISPARITIES,
        BLOCK,
        P1=8 * area,
        P2=32 * area,
        disp12MaxDiff=1,
        preFilterCap=63,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=1,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    lefts = sorted((drive / "image_02" / "data").glob("*.png"))
    with (
        (out / "plain.mcap").open("wb") as file,
        Writer(file, compression=CompressionType.LZ4) as log,
    ):
        for index, path in enumerate(lefts):
            when_ns = 10**9 + index * 10**8
            when = stamp(when_ns)
            left = cv2.imread(str(path))
            right = cv2.imread(str(drive / "image_03" / "data" / path.name))
            grey = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (left, right)]
            disparity = matcher.compute(*grey).astype(np.float32) / 16
            disparity[disparity <= 0] = np.nan
            depth = FOCAL_PX * BASELINE_M / disparity
            height, width = depth.shape
            u, v = np.meshgrid(np.arange(width), np.arange(height))
            xyz = np.dstack([(u - CX) * depth / FOCAL_PX, (v - CY) * depth / FOCAL_PX, depth])
            good = np.isfinite(depth) & (np.linalg.norm(xyz, axis=2) < MAX_RANGE_M)
            points, colours = xyz[good], left[good][:, ::-1]

            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
            cloud.colors = o3d.utility.Vector3dVector(colours / 255.0)
            o3d.io.write_point_cloud(str(out / "pcd" / f"{path.stem}.pcd"), cloud)

            def write(topic: str, message: object, when_ns: int = when_ns) -> None:
                log.write_message(topic, message, log_time=when_ns, publish_time=when_ns)

            for side, image in (("left", left), ("right", right)):
                data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
                common = {"timestamp": when, "frame_id": f"camera_{side}"}
                write(f"/camera/{side}/image", CompressedImage(data=data, format="jpeg", **common))
                K = [FOCAL_PX, 0, CX, 0, FOCAL_PX, CY, 0, 0, 1]
                size = {"width": width, "height": height}
                write(f"/camera/{side}/calibration", CameraCalibration(K=K, **size, **common))
            depth_mm = np.nan_to_num(np.clip(1000 * depth, 0, 65535)).astype(np.uint16)
            for topic, encoding, array in (
                ("/stereo/disparity", "32FC1", disparity),
                ("/stereo/depth", "16UC1", depth_mm),
            ):
                raw = RawImage(
                    timestamp=when,
                    frame_id="camera_left",
                    width=width,
                    height=height,
                    encoding=encoding,
                    step=array.strides[0],
                    data=array.tobytes(),
                )
                write(topic, raw)
            write("/stereo/points", cloud_message(points, colours, when))
            frames = {"parent_frame_id": "base_link", "child_frame_id": "camera_left"}
            T = FrameTransform(timestamp=when, **frames)
            T.rotation.w = 1
            write("/tf", T)
    return len(lefts), time.perf_counter() - begin


if __name__ == "__main__":
    frames, seconds = convert(Path(sys.argv[1]), Path(sys.argv[2]))
    print(f"{frames} frames, {seconds:.3f} s, {frames / seconds:.2f} frames/s")
