"""Scans put right where a source is opened: a drive on disk whose LiDAR turned while it moved."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud as PointCloudMessage
from mcap.reader import make_reader
from scipy.linalg import expm

from pseudolidar.cli import main
from pseudolidar.errors import SequenceTime, UsageError
from pseudolidar.formats.points.pcd import read_pcd
from pseudolidar.formats.points.velodyne_bin import write_velodyne_bin
from pseudolidar.formats.rigs.kitti import (
    CAM_TO_CAM,
    IMU_TO_VELO,
    VELO_TO_CAM,
    read_raw_calib,
    write_raw_calib,
)
from pseudolidar.formats.timestamps import read_timestamps, write_timestamps
from pseudolidar.geometry.scan_motion import turning_times_ns
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.other_rig import opened_as_taken, opened_with_rig
from pseudolidar.sources.scans_put_right import Scans
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.pose import Pose

FRAMES = 3
TURN_NS = 100_000_000
LATE_NS = 10_000_000  # pictures are stamped so long after the LiDAR faces forward
VELOCITY, RATES = (12.0, 0.3, 0.0), (0.0, 0.01, 0.4)
# The IMU stands behind the LiDAR, and is turned by 10 degrees.
YAW = np.deg2rad(10)
T_VELODYNE_IMU = np.array(
    [
        [np.cos(YAW), -np.sin(YAW), 0, -0.8],
        [np.sin(YAW), np.cos(YAW), 0, 0.3],
        [0, 0, 1, -0.9],
        [0, 0, 0, 1],
    ]
)


def stood(seconds) -> np.ndarray:
    """(..., 4, 4) where the LiDAR stood so much later, as it was at the moment."""
    twist = np.zeros((4, 4))
    twist[:3, :3] = np.cross(np.eye(3), RATES)
    twist[:3, 3] = VELOCITY
    moved = expm(twist * np.asarray(seconds)[..., None, None])
    return T_VELODYNE_IMU @ moved @ np.linalg.inv(T_VELODYNE_IMU)


def seen_from(place: np.ndarray, world: np.ndarray) -> np.ndarray:
    """(N, 3) points as the LiDAR has them from a place, or from a place for each of them."""
    return np.linalg.solve(place, np.c_[world, np.ones(len(world))][..., None])[:, :3, 0]


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A rendered drive, its scans and packets as a car that moves would have them."""
    out = tmp_path_factory.mktemp("turning")
    small = ("--width-px", "320", "--frames", str(FRAMES))
    assert main(["synth", str(out / "drive"), "--layout", "raw", *small]) == 0
    (place,) = (path.parents[1] for path in out.rglob("velodyne_points/data"))
    stamps = read_timestamps(place / "velodyne_points" / "timestamps.txt")
    scans = KittiRaw(str(place)).open()
    calibration = read_raw_calib(
        *(place.parent / n for n in (CAM_TO_CAM, VELO_TO_CAM, IMU_TO_VELO))
    )
    imu = Pose("velodyne", "imu", T_VELODYNE_IMU)
    write_raw_calib(place.parent, replace(calibration.rig((2, 3)), T_velodyne_imu=imu))
    for index in range(FRAMES):
        begin_ns = stamps[index] - TURN_NS // 2
        world = scans.load(index).scan.xyz.astype(np.float64)[::20]
        # Straight behind a turn ends and the next begins: what is there may be seen twice, or not.
        world = world[np.abs(np.arctan2(world[:, 1], world[:, 0])) < 3.0]
        np.save(place / f"world_{index}.npy", world)
        seen = world.copy()
        for _ in range(4):  # when a point is seen depends on where it is seen
            times = turning_times_ns(seen, (begin_ns, begin_ns + TURN_NS))
            seconds = (times - stamps[index]) / 1e9
            seen = seen_from(stood(seconds), world)
        path = place / "velodyne_points" / "data" / f"{index:010d}.bin"
        write_velodyne_bin(path, LidarScan(seen.astype(np.float32)))
        packet = place / "oxts" / "data" / f"{index:010d}.txt"
        words = packet.read_text().split()
        words[3:5] = ["0", "0"]  # level: the packet's velocities are, too
        words[8:11], words[17:20] = map(str, VELOCITY), map(str, RATES)
        packet.write_text(" ".join(words) + "\n")
    for name, shift_ns in (("_start", -TURN_NS // 2), ("_end", TURN_NS // 2)):
        path = place / "velodyne_points" / f"timestamps{name}.txt"
        write_timestamps(path, [stamp + shift_ns for stamp in stamps])
    for name in ("image_02", "image_03"):
        write_timestamps(place / name / "timestamps.txt", [stamp + LATE_NS for stamp in stamps])
    return place


def world_of(drive: Path, index: int) -> np.ndarray:
    return np.load(drive / f"world_{index}.npy")


def test_points_come_to_where_they_are_at_one_moment(drive):
    source = opened_with_rig(KittiRaw(str(drive)), None, scans=Scans())
    notes = [note for note in source.summary.notes if note.startswith("scans:")]
    assert notes == [
        "scans: moved by the IMU's motion to the moment the LiDAR faces forward and triggers the "
        "cameras"
    ]
    for index in range(FRAMES):
        frame = source.load(index)
        # azimuths are of float32, 1e-7 of a turn
        np.testing.assert_allclose(frame.scan.xyz, world_of(drive, index), atol=2e-4)
        assert frame.scan.turn_ns is None
    as_stored = KittiRaw(str(drive)).open().load(0)
    off_m = np.linalg.norm(as_stored.scan.xyz - world_of(drive, 0), axis=1)
    assert off_m.max() > 0.3


def test_the_picture_s_stamp_is_another_moment(drive):
    frame = opened_with_rig(KittiRaw(str(drive)), None, scans=Scans("picture")).load(1)
    # 10 ms on, at 12 m/s
    later = seen_from(stood(LATE_NS / 1e9), world_of(drive, 1))
    np.testing.assert_allclose(frame.scan.xyz, later, atol=2e-4)
    assert np.linalg.norm(later - world_of(drive, 1), axis=1).mean() > 0.1
    assert frame.scan.timestamp_ns == frame.timestamp_ns


def test_nothing_is_done_unless_it_is_known_and_wanted(drive, tmp_path):
    for wanted in (None, Scans("none")):
        source = opened_with_rig(KittiRaw(str(drive)), None, scans=wanted)
        assert not any(note.startswith("scans:") for note in source.summary.notes)
        assert source.load(0).scan.turn_ns is not None
    date = tmp_path / drive.parent.name
    shutil.copytree(drive.parent, date)
    (date / drive.name / "velodyne_points" / "timestamps_end.txt").unlink()
    source = opened_as_taken(KittiRaw(str(date)), None, scans=Scans())
    assert not any(note.startswith("scans:") for note in source.summary.notes)
    np.testing.assert_array_equal(
        source.load(0).scan.xyz, KittiRaw(str(drive)).open().load(0).scan.xyz
    )


@pytest.mark.parametrize("name", ["timestamps_start.txt", "timestamps_end.txt"])
@pytest.mark.parametrize("content", [b"2011-09-26 13:02:25.1\nnoon\n", b"\xff\xfe\x00", b"1_000"])
def test_times_of_turns_that_nobody_can_read_are_warned_of(name, content, drive, tmp_path, capsys):
    """They only serve to move points; nothing else needs them."""
    date = tmp_path / drive.parent.name
    shutil.copytree(drive.parent, date)
    path = date / drive.name / "velodyne_points" / name
    path.write_bytes(content)
    source = opened_with_rig(KittiRaw(str(date)), None, scans=Scans())
    (warning,) = (note for note in source.summary.notes if note.startswith("warning:"))
    assert "scans are not moved to one moment: SequenceTime" in warning
    assert name in warning
    assert source.load(0).scan.turn_ns is None
    assert not any(note.startswith("scans:") for note in source.summary.notes)
    if content.endswith(b"noon\n"):
        assert "line 2" in warning
        assert main(["convert", str(date), str(tmp_path / "out"), "--frames", "0"]) == 0
        assert "noon" in capsys.readouterr().err
    # the file that tells which scan belongs to which picture is another matter
    path.with_name("timestamps.txt").write_bytes(content)
    with pytest.raises(SequenceTime):
        KittiRaw(str(date)).open()


def test_beams_are_raised(drive):
    source = opened_with_rig(KittiRaw(str(drive)), None, scans=Scans("none", tilt_deg=0.2))
    assert "scans: beams raised by 0.2 degrees" in source.summary.notes
    raised, plain = source.load(0).scan.xyz, KittiRaw(str(drive)).open().load(0).scan.xyz
    elevations = [np.arctan2(p[:, 2], np.hypot(p[:, 0], p[:, 1])) for p in (raised, plain)]
    np.testing.assert_allclose(np.rad2deg(elevations[0] - elevations[1]), 0.2, atol=1e-3)
    with pytest.raises(UsageError, match="tilt of 20 degrees"):
        Scans(tilt_deg=20)
    with pytest.raises(UsageError):
        Scans(tilt_deg=float("nan"))


def test_scans_belong_to_pictures_by_time(drive, tmp_path):
    date = tmp_path / drive.parent.name
    shutil.copytree(drive.parent, date)
    points = date / drive.name / "velodyne_points"
    stamps = read_timestamps(points / "timestamps.txt")
    # the LiDAR began one turn before the cameras: its scan k belongs to picture k - 1
    step_ns = stamps[1] - stamps[0]
    for index in reversed(range(FRAMES)):
        path = points / "data" / f"{index:010d}.bin"
        path.rename(points / "data" / f"{index + 1:010d}.bin")
    write_timestamps(points / "timestamps.txt", [stamps[0] - step_ns, *stamps])
    for name in ("_start", "_end"):
        (points / f"timestamps{name}.txt").unlink()
    source = KittiRaw(str(date)).open()
    assert "velodyne: scans by time, 3 of 3 have another number" in source.summary.notes
    first = opened_with_rig(KittiRaw(str(drive)), None).load(0)
    np.testing.assert_array_equal(source.load(0).scan.xyz, first.scan.xyz)
    assert source.load(0).scan.timestamp_ns == stamps[0]
    # a turn that is lost is missing, and its neighbour does not stand in for it
    (points / "data" / f"{2:010d}.bin").unlink()
    lines = (points / "timestamps.txt").read_text().splitlines()
    source = KittiRaw(str(date)).open()
    assert source.load(1).scan is None
    assert source.load(2).scan is not None
    assert "velodyne of 1 of 3 frames" in source.summary.absent
    # times that do not increase pair nothing: numbers do
    lines[1], lines[3] = lines[3], lines[1]
    (points / "timestamps.txt").write_text("\n".join(lines) + "\n")
    assert KittiRaw(str(date)).open().frames[1].scan.name == f"{1:010d}.bin"


def test_clouds_are_guided_by_scans_put_right(drive, tmp_path, capsys):
    """As by a LiDAR that stands; and what is recorded of a scan is what was stored."""
    date = tmp_path / "standing" / drive.parent.name
    shutil.copytree(drive.parent, date)
    points = date / drive.name / "velodyne_points"
    (points / "timestamps_end.txt").unlink()
    write_velodyne_bin(
        points / "data" / "0000000001.bin", LidarScan(world_of(drive, 1).astype(np.float32))
    )
    clouds = {}
    for name, source, deskew in (
        ("standing", date, "trigger"),
        ("put right", drive, "trigger"),
        ("as stored", drive, "none"),
    ):
        args = ["convert", source, tmp_path / name, "--guide", "scan", "--scans.deskew", deskew]
        args += ["--frames", "1", "--frame", "camera_left", "--to", "pcd,mcap"]
        assert main([str(each) for each in args]) == 0
        told = "guide: scans: moved by the IMU's motion" in capsys.readouterr().err
        assert told == (name == "put right")
        clouds[name] = read_pcd(tmp_path / name / "pcd" / "0000000001.pcd").xyz
    off_m = {
        name: np.linalg.norm(cloud - clouds["standing"], axis=1) for name, cloud in clouds.items()
    }
    assert np.quantile(off_m["put right"], 0.95) < 0.002
    assert np.quantile(off_m["as stored"], 0.95) > 0.05
    (recording,) = (tmp_path / "put right").glob("*.mcap")
    with recording.open("rb") as stream:
        (message,) = (m for _, _, m in make_reader(stream).iter_messages(["/velodyne/points"]))
    recorded = PointCloudMessage.FromString(message.data)
    floats = np.frombuffer(recorded.data, np.float32).reshape(-1, recorded.point_stride // 4)
    stored = KittiRaw(str(drive)).open().load(1).scan.xyz
    np.testing.assert_array_equal(floats[:, :3], stored)
