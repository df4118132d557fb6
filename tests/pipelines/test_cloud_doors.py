"""Clouds from one format to another through `convert`: the same cloud comes out."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pseudolidar.pipelines.convert import Convert, run
from rosbags.rosbag2 import Reader as Rosbag2Reader

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.mcap.content import McapContent, ProfileName
from pseudolidar.formats.points.cloud_file import read_cloud
from pseudolidar.formats.points.npz import encode_npz
from pseudolidar.formats.points.pcd import encode_pcd
from pseudolidar.formats.points.ply import encode_ply
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin, write_velodyne_bin
from pseudolidar.running.products.outputs import Outputs
from pseudolidar.sources.recognise import recognise
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import LidarScan
from tests.recordings import (
    ROS,
    START_NS,
    named_clouds,
    ros2_messages,
    ros_cloud,
    scan_records,
    small_drive,
    write_own,
    write_ros2_bag,
)

WRITERS: dict[str, Callable[[PointCloud], bytes]] = {
    "pcd": encode_pcd,
    "pcd:compressed": lambda cloud: encode_pcd(cloud, encoding="binary_compressed"),
    "pcd:ascii": lambda cloud: encode_pcd(cloud, encoding="ascii"),
    "ply": encode_ply,
    "ply:ascii": lambda cloud: encode_ply(cloud, encoding="ascii"),
    "npz": encode_npz,
}
CloudMaker = Callable[..., PointCloud]


def convert(source: Path, out: Path, to: str, **options: object) -> dict:
    run(Convert(recognise(str(source)), out, to=Outputs.parse(to), **options))  # type: ignore[arg-type]
    return json.loads((out / "report.json").read_text())


@pytest.fixture(scope="module")
def clouds(make_cloud: CloudMaker) -> list[PointCloud]:
    """All columns; organised with holes; empty; one point; coordinates of a map."""
    whole = make_cloud(60)
    utm = replace(make_cloud(50, wide=True), frame="utm")
    far = np.array([456_789.012_345_678, 5_428_123.987_654, 112.5])
    utm = replace(utm, xyz=utm.xyz + far)
    made = [whole, make_cloud(48, shape=(6, 8)), make_cloud(0), make_cloud(1), utm]
    return [replace(cloud, timestamp_ns=START_NS + i) for i, cloud in enumerate(made)]


@pytest.mark.parametrize("to", ["pcd,ply,npz", "pcd:compressed,ply:ascii", "pcd:ascii"])
@pytest.mark.parametrize("kind", WRITERS)
def test_the_same_cloud_comes_out_of_every_door(
    kind: str,
    to: str,
    clouds: list[PointCloud],
    tmp_path: Path,
    assert_same_cloud: Callable[..., None],
) -> None:
    suffix = kind.partition(":")[0]
    for index, cloud in enumerate(clouds):
        write_atomic(tmp_path / "in" / f"{index}.{suffix}", WRITERS[kind](cloud))
    convert(tmp_path / "in", tmp_path / "out", to)
    for folder in {part.partition(":")[0] for part in to.split(",")}:
        for index, cloud in enumerate(clouds):
            got = read_cloud(tmp_path / "out" / folder / f"{index}.{folder}")
            assert_same_cloud(got, cloud)


def test_through_every_format_in_turn(
    clouds: list[PointCloud], tmp_path: Path, assert_same_cloud: Callable[..., None]
) -> None:
    at = tmp_path / "start"
    for index, cloud in enumerate(clouds):
        write_atomic(at / f"{index}.npz", encode_npz(cloud))
    for step, kind in enumerate(("pcd", "ply", "npz", "ply:ascii", "pcd:compressed")):
        convert(at, tmp_path / str(step), kind)
        at = tmp_path / str(step) / kind.partition(":")[0]
    for index, cloud in enumerate(clouds):
        assert_same_cloud(read_cloud(at / f"{index}.pcd"), cloud)


@pytest.mark.parametrize("kind", ["pcd", "ply", "npz"])
def test_a_scan_keeps_its_turn_and_its_reflectances(kind: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    scan = LidarScan(rng.normal(size=(99, 3)).astype(np.float32) * 20, rng.random(99, np.float32))
    (tmp_path / "in").mkdir()
    write_velodyne_bin(tmp_path / "in" / "7.bin", scan)
    convert(tmp_path / "in", tmp_path / "out", kind)
    cloud = read_cloud(tmp_path / "out" / kind / f"7.{kind}")
    np.testing.assert_array_equal(cloud.xyz, scan.xyz)
    np.testing.assert_array_equal(cloud.intensity, scan.reflectance)
    convert(tmp_path / "out" / kind, tmp_path / "back", "bin")
    data = (tmp_path / "back" / "bin" / "7.bin").read_bytes()
    assert data == (tmp_path / "in" / "7.bin").read_bytes()


def test_what_a_bin_cannot_hold_is_said(clouds: list[PointCloud], tmp_path: Path) -> None:
    for index, cloud in enumerate(clouds):
        placed = replace(cloud, frame="velodyne") if cloud.frame == "camera_left" else cloud
        write_atomic(tmp_path / "in" / f"{index}.npz", encode_npz(placed))
    with pytest.raises(Exception, match=r"beyond 10000 m.*ply or npz"):
        convert(tmp_path / "in", tmp_path / "stopped", "bin", on_error="stop")
    (tmp_path / "in" / "4.npz").unlink()
    report = convert(tmp_path / "in", tmp_path / "out", "bin")
    text = json.dumps(report)
    assert "rgb, sigma_m, uv, of_bool" in text
    holes = read_velodyne_bin(tmp_path / "out" / "bin" / "1.bin")
    assert len(holes) == clouds[1].valid.sum()


def test_broken_files_are_skipped_and_named(make_cloud: CloudMaker, tmp_path: Path) -> None:
    for index in range(25):
        data = encode_pcd(replace(make_cloud(20), timestamp_ns=START_NS + index))
        write_atomic(tmp_path / "in" / f"{index}.pcd", data[:-7] if index == 9 else data)
    report = convert(tmp_path / "in", tmp_path / "out", "ply")
    assert "9.pcd" in json.dumps(report["skipped"])
    assert "PointFileTruncated" in json.dumps(report["skipped"])
    written = sorted(int(file.stem) for file in (tmp_path / "out" / "ply").iterdir())
    assert written == [n for n in range(25) if n != 9]


# --- recordings -----------------------------------------------------------------------------


def test_a_recorded_cloud_is_placed_by_the_transforms(tmp_path: Path) -> None:
    drive = small_drive(3)
    path = write_ros2_bag(tmp_path / "bag", ros2_messages(drive))
    source = replace(recognise(str(path)), take="clouds")  # type: ignore[type-var]
    for frame in ("map", "left_optical", "velo_link"):
        job = Convert(source, tmp_path / frame, to=Outputs.parse("npz"), frame=frame)  # type: ignore[arg-type]
        run(job)
    scan = drive[2].scan
    assert scan is not None
    kept = read_cloud(tmp_path / "velo_link" / "npz" / "000002.npz")
    np.testing.assert_array_equal(kept.xyz, scan.xyz)
    assert kept.frame == "velo_link"
    T_left_velodyne = drive[2].rig.T_left_velodyne
    assert T_left_velodyne is not None
    optical = read_cloud(tmp_path / "left_optical" / "npz" / "000002.npz")
    np.testing.assert_allclose(optical.xyz, T_left_velodyne.apply(scan.xyz), atol=1e-5)
    # The scan is 7 ms after its pair: the car is at 2 m and the last transform.
    world = read_cloud(tmp_path / "map" / "npz" / "000002.npz")
    pose = drive[2].pose
    assert pose is not None
    expected = scan.xyz @ pose.matrix[:3, :3].T.astype(np.float32) + pose.translation_m
    np.testing.assert_allclose(world.xyz, expected, atol=1e-4)
    with pytest.raises(Exception, match=r"no transforms from 'velo_link' to 'mars'"):
        run(Convert(source, tmp_path / "x", frame="mars", on_error="stop"))  # type: ignore[arg-type]


@pytest.mark.parametrize("profile", ["foxglove", "ros2"])
def test_clouds_in_a_recording_stay_as_they_are(
    profile: ProfileName,
    clouds: list[PointCloud],
    tmp_path: Path,
    assert_same_cloud: Callable[..., None],
) -> None:
    """Rows and columns with their holes, 64-bit integers to the last bit, source pixels."""
    for index, cloud in enumerate(clouds):
        write_atomic(tmp_path / "in" / f"{index}.npz", encode_npz(cloud))
    convert(tmp_path / "in", tmp_path / "out", "mcap", mcap=McapContent(profile=profile))
    (recording,) = (tmp_path / "out").glob("*.mcap")
    convert(recording, tmp_path / "back", "npz")
    for index, cloud in enumerate(clouds):
        assert_same_cloud(read_cloud(tmp_path / "back" / "npz" / f"{index}.npz"), cloud)


def test_ros_sees_the_rows_and_columns_of_an_organised_cloud(
    clouds: list[PointCloud], tmp_path: Path
) -> None:
    organised = clouds[1]
    write_atomic(tmp_path / "in" / "1.npz", encode_npz(organised))
    convert(tmp_path / "in", tmp_path / "out", "mcap", mcap=McapContent(profile="ros2"))
    with Rosbag2Reader(tmp_path / "out") as bag:
        (message,) = (
            ROS.deserialize_cdr(data, connection.msgtype)
            for connection, _, data in bag.messages()
            if connection.msgtype == "sensor_msgs/msg/PointCloud2"
        )
    assert (message.height, message.width) == organised.shape
    assert message.row_step == message.point_step * message.width
    assert not message.is_dense


def test_names_of_frames_never_lead_out_of_the_output(
    make_cloud: CloudMaker, tmp_path: Path
) -> None:
    """A recording names its frames; links in the output folder are replaced, not followed."""
    names = ["../escaped", "/tmp/absolute", "CON", "a\0b", "y" * 400, ".hidden", "fine"]
    write_own(tmp_path / "in.mcap", named_clouds(names))
    out, outside = tmp_path / "deep" / "out", tmp_path / "outside"
    (out / "pcd").mkdir(parents=True)
    outside.write_text("mine")
    (out / "pcd" / "fine.pcd").symlink_to(outside)
    convert(tmp_path / "in.mcap", out, "pcd")
    assert outside.read_text() == "mine"
    assert not (out / "pcd" / "fine.pcd").is_symlink()
    files = list(tmp_path.rglob("*.pcd"))
    assert len(files) == len(names)
    assert all(path.parent == out / "pcd" for path in files)


def test_a_recording_through_all_formats(
    tmp_path: Path, assert_same_cloud: Callable[..., None]
) -> None:
    """MCAP to PCD, PCD to PLY, PLY to npz: columns of a driver that we never heard of."""
    scan = small_drive(1)[0].scan
    assert scan is not None
    plain = scan_records(scan)
    dtype = np.dtype(
        [
            *((n, "<f4") for n in ("x", "y", "z", "intensity")),
            ("t", "<u4"),
            ("reflectivity", "<u2"),
            ("ring", "u1"),
            ("ambient", "<i2"),
            ("range", "<f8"),
        ]
    )
    records = np.zeros(len(scan), dtype)
    for name in ("x", "y", "z", "intensity"):
        records[name] = plain[name]
    for number, name in enumerate(("t", "reflectivity", "ring", "ambient", "range")):
        records[name] = np.arange(len(scan)) * (number + 1)
    message = ros_cloud(records, START_NS, "os_sensor")
    at = write_ros2_bag(tmp_path / "bag", [("/points", message, START_NS)], "mcap")
    for kind in ("pcd", "ply", "npz"):
        convert(at, tmp_path / kind, kind)
        at = tmp_path / kind / kind
    cloud = read_cloud(at / "000000.npz")
    assert (cloud.frame, cloud.timestamp_ns) == ("os_sensor", START_NS)
    np.testing.assert_array_equal(cloud.xyz, scan.xyz)
    np.testing.assert_array_equal(cloud.intensity, scan.reflectance)
    for name in ("t", "reflectivity", "ring", "ambient", "range"):
        assert cloud.extra[name].dtype == dtype[name]
        np.testing.assert_array_equal(cloud.extra[name], records[name])
