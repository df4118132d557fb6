"""KITTI raw before rectification: eyes and scans by time, cameras as mounted, scans as text."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationValue,
    NotRectified,
    PairMismatch,
    SequenceTime,
    SourceEmpty,
    SourceUnknown,
    UsageError,
)
from pseudolidar.formats.oxts import OxtsPacket, packet_at, write_oxts
from pseudolidar.formats.rigs.key_values import key_values_text
from pseudolidar.formats.rigs.kitti import write_raw_calib
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.timestamps import write_timestamps
from pseudolidar.geometry.rectification import rectification
from pseudolidar.sources.kitti.drives import is_unrectified
from pseudolidar.sources.kitti.extract import KittiExtract
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.scan_times import numbered
from pseudolidar.sources.other_rig import opened_with_rig
from pseudolidar.sources.recognise import recognise
from pseudolidar.structures.frame import RawPair
from pseudolidar.structures.pose import Pose
from tests.extract_drives import (
    DATE,
    DRIVE,
    START_NS,
    STEP_NS,
    VELO_TO_CAM,
    some_scan,
    stamps,
    write_calibration,
    write_pictures,
    write_scans,
)
from tests.lens_worlds import world_rig

SIZE_PX = (48, 36)
FRAMES = 6
RIG = world_rig("pinhole", SIZE_PX, focal_px=40.0)
RIG = replace(
    RIG,
    left=replace(RIG.left, distortion=RIG.left.distortion[:5]),
    right=replace(RIG.right, distortion=RIG.right.distortion[:5]),
)


def pictures(seed, count=FRAMES):
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 255, SIZE_PX[::-1], dtype=np.uint8) for _ in range(count)]


@pytest.fixture
def drive(tmp_path):
    folder = tmp_path / DATE / DRIVE
    write_calibration(folder.parent, RIG)
    for camera in (0, 1):
        write_pictures(folder, camera, pictures(camera), stamps(FRAMES, late_ns=camera * 1_000_000))
    return folder


def test_pairs_with_the_cameras_as_they_are_mounted(drive):
    for path in (drive, drive.parent, drive.parent.parent):
        settings = recognise(str(path))
        assert isinstance(settings, KittiExtract)
        source = settings.open()
        assert source.ids == tuple(f"{n:010d}" for n in range(FRAMES))
        assert source.timestamps_ns == tuple(stamps(FRAMES))
    pair = source.load(3)
    assert isinstance(pair, RawPair)
    np.testing.assert_array_equal(pair.right, pictures(1)[3])
    assert (pair.index, pair.scan, source.refused) == (3, None, ())
    np.testing.assert_array_equal(pair.rig.left.K, RIG.left.K)
    np.testing.assert_array_equal(pair.rig.right.distortion, RIG.right.distortion)
    np.testing.assert_allclose(pair.rig.T_right_left.matrix, RIG.T_right_left.matrix, atol=1e-15)
    np.testing.assert_allclose(pair.rig.T_left_velodyne.matrix, VELO_TO_CAM.matrix, atol=1e-15)
    assert (pair.rig.T_left_velodyne.dst, pair.rig.right.frame) == ("camera_left", "camera_right")
    assert f"of {DATE}" in source.rig.origin
    assert "1 ms apart at most" in source.summary.notes[0]
    assert "eyes 0.12008 m apart" in source.summary.line


def test_colour_cameras_stand_beside_camera_0(drive):
    write_calibration(drive.parent, RIG, cameras=(2, 3))
    for camera in (0, 1):
        (drive / f"image_0{camera}").rename(drive / f"image_0{camera + 2}")
    rig = KittiExtract(str(drive)).open().rig
    np.testing.assert_allclose(rig.T_right_left.matrix, RIG.T_right_left.matrix, atol=1e-12)
    shift = rig.T_left_velodyne.translation_m - VELO_TO_CAM.translation_m
    np.testing.assert_allclose(shift, (0.06, 0.001, 0.002), atol=1e-12)


def test_eyes_are_paired_by_time_where_one_has_dropped_a_frame(drive):
    """The right camera lost frame 2: its picture 2 is of the moment of the left picture 3."""
    right = pictures(1)
    del right[2]
    times = stamps(FRAMES)
    del times[2]
    shutil.rmtree(drive / "image_01")
    write_pictures(drive, 1, right, times)
    source = KittiExtract(str(drive)).open()
    assert source.ids == tuple(f"{n:010d}" for n in (0, 1, 3, 4, 5))
    np.testing.assert_array_equal(source.load(2).right, pictures(1)[3])
    (name, error), *others = source.refused
    assert (name, others) == ("0000000002", [])
    assert isinstance(error, PairMismatch)
    assert "100 ms away" in error.got
    assert any("3 of 5 pairs have eyes of different numbers" in n for n in source.summary.notes)


def test_a_right_picture_with_a_partner_is_not_left_out_whatever_its_number(drive):
    """The left camera lost frame 2: the right picture 5 belongs to the left picture 4."""
    left, times = pictures(0), stamps(FRAMES)
    del left[2], times[2]
    shutil.rmtree(drive / "image_00")
    write_pictures(drive, 0, left, times)
    source = KittiExtract(str(drive)).open()
    assert source.ids == tuple(f"{n:010d}" for n in range(5))
    np.testing.assert_array_equal(source.load(4).right, pictures(1)[5])
    assert source.refused == ()


def test_pairs_whose_times_disagree_are_left_out_and_told(drive):
    late = [0, 3_000_000, 12_000_000, 0, 25_000_000, 0]
    times = [stamp + by for stamp, by in zip(stamps(FRAMES), late, strict=True)]
    write_timestamps(drive / "image_01" / "timestamps.txt", times)
    source = KittiExtract(str(drive)).open()
    assert source.ids == tuple(f"{n:010d}" for n in (0, 1, 3, 5))
    assert [name for name, _ in source.refused] == ["0000000002", "0000000004"]
    assert "12 ms away" in source.refused[0][1].got
    assert "--max-skew" in source.refused[0][1].fix
    assert len(KittiExtract(str(drive), max_skew=0.03).open().ids) == FRAMES
    assert len(KittiExtract(str(drive), max_skew=0.001).open().ids) == 3
    write_timestamps(drive / "image_01" / "timestamps.txt", stamps(FRAMES, late_ns=40_000_000))
    with pytest.raises(SourceEmpty, match="40 ms away"):
        KittiExtract(str(drive)).open()
    with pytest.raises(UsageError):
        KittiExtract(str(drive), max_skew=-1.0)


def test_without_times_equal_numbers_are_pairs_and_that_is_said(drive):
    (drive / "image_01" / "timestamps.txt").unlink()
    source = KittiExtract(str(drive)).open()
    assert source.timestamps_ns == tuple(stamps(FRAMES))
    assert any("no image_01/timestamps.txt" in note for note in source.summary.notes)
    (drive / "image_00" / "timestamps.txt").unlink()
    source = KittiExtract(str(drive), rate_hz=20.0).open()
    assert source.timestamps_ns[1] - source.timestamps_ns[0] == 50_000_000
    assert any("synthetic" in note for note in source.summary.notes)


def test_scans_are_found_by_time(drive):
    """The LiDAR began two pictures late: scan k is of the moment of picture k + 2."""
    scans = [some_scan(k) for k in range(4)]
    write_scans(drive, scans, [START_NS + (k + 2) * STEP_NS - 7 for k in range(4)])
    source = KittiExtract(str(drive)).open()
    frames = [source.load(index) for index in range(FRAMES)]
    assert [f.scan is not None for f in frames] == [False, False, True, True, True, True]
    np.testing.assert_array_equal(frames[3].scan.xyz, scans[1].xyz)
    np.testing.assert_array_equal(frames[3].scan.reflectance, scans[1].reflectance)
    assert frames[3].scan.timestamp_ns == START_NS + 3 * STEP_NS - 7
    assert "velodyne of 2 of 6 frames" in source.summary.absent
    assert any("4 of 4 have another number" in note for note in source.summary.notes)


def test_scans_without_times_are_taken_by_number_or_as_said(drive):
    write_scans(drive, [some_scan(k) for k in range(4)])
    source = KittiExtract(str(drive)).open()
    np.testing.assert_array_equal(source.load(3).scan.xyz, some_scan(3).xyz)
    assert any("--scan-offset" in note for note in source.summary.notes)
    said = KittiExtract(str(drive), scan_offset=2).open()
    np.testing.assert_array_equal(said.load(3).scan.xyz, some_scan(1).xyz)
    assert said.load(1).scan is None
    assert said.load(3).scan.timestamp_ns == said.timestamps_ns[3]


def test_the_imu_is_read_by_time(drive):
    """Ten packets for each picture; the car drives 1 m from picture to picture."""
    write_calibrated_imu(drive)
    first = OxtsPacket(49.0, 8.4, 116.0, 0.01, -0.02, 0.7)
    folder = drive / "oxts" / "data"
    for n in range(10 * FRAMES):
        at = Pose.from_rotation("map", "base_link", np.eye(3), np.array([0.1 * n, 0.0, 0.0]))
        write_oxts(folder / f"{n:010d}.txt", packet_at(at, first))
    times = [START_NS + n * STEP_NS // 10 for n in range(10 * FRAMES)]
    write_timestamps(folder.parent / "timestamps.txt", times)
    source = KittiExtract(str(drive)).open()
    assert source.summary.line.endswith("poses")
    for index in (0, 3):
        pair = source.load(index)
        np.testing.assert_allclose(pair.pose.translation_m, (index, 0, 0), atol=1e-3)
        assert pair.motion is not None


def test_nothing_in_metres_stays_beside_a_rig_of_unknown_scale(drive, tmp_path):
    """Poses of the IMU would be taken for those of a camera, in a unit that nobody knows."""
    write_calibrated_imu(drive)
    write_scans(drive, [some_scan(k) for k in range(FRAMES)], stamps(FRAMES))
    folder = drive / "oxts" / "data"
    for n in range(FRAMES):
        write_oxts(folder / f"{n:010d}.txt", OxtsPacket(49.0, 8.4, 116.0, 0.01, -0.02, 0.7))
    write_timestamps(folder.parent / "timestamps.txt", stamps(FRAMES))
    own = opened_with_rig(KittiExtract(str(drive)), None).load(1)
    assert None not in (own.pose, own.motion, own.scan, own.rig.T_left_velodyne)
    for metric in (True, False):
        write_rig(tmp_path / "rig.json", replace(RIG, metric=metric))
        source = opened_with_rig(KittiExtract(str(drive)), tmp_path / "rig.json")
        frame = source.load(1)
        held = (frame.pose, frame.motion, frame.scan, frame.rig.T_left_velodyne)
        assert [each is not None for each in held] == [metric] * 4
        told = any("lengths of the rig are no metres" in note for note in source.summary.notes)
        assert told is not metric


def test_a_packet_of_another_moment_is_none_of_a_picture(drive):
    write_calibrated_imu(drive)
    folder = drive / "oxts" / "data"
    for n in range(3):
        write_oxts(folder / f"{n:010d}.txt", OxtsPacket(49.0, 8.4, 116.0, 0.01, -0.02, 0.7))
    near_ns = (19_000_000, 21_000_000, 0)
    times = [START_NS + n * STEP_NS + by for n, by in enumerate(near_ns)]
    write_timestamps(folder.parent / "timestamps.txt", times)
    source = KittiExtract(str(drive)).open()
    told = [source.load(n).pose is not None for n in range(FRAMES)]
    assert told == [True, False, True, False, False, False]


def test_scans_that_say_when_they_turned_tell_it(drive):
    write_calibrated_imu(drive)
    times = stamps(FRAMES)
    write_scans(drive, [some_scan(k) for k in range(FRAMES)], times)
    for name, by_ns in (("start", -50_000_000), ("end", 49_000_000)):
        moved = [stamp + by_ns for stamp in times]
        write_timestamps(drive / "velodyne_points" / f"timestamps_{name}.txt", moved)
    scan = KittiExtract(str(drive)).open().load(2).scan
    assert scan.turn_ns == (times[2] - 50_000_000, times[2] + 49_000_000)


def test_a_drive_of_another_name_is_told_by_the_size_of_its_pictures(drive):
    small = rectification(RIG, size_px=(40, 30))
    write_raw_calib(drive.parent, RIG, rectified=small)
    other = drive.rename(drive.with_name("2026_01_02_drive_0007"))
    assert is_unrectified(other)
    for camera in (0, 1):
        shutil.rmtree(other / f"image_0{camera}")
        write_pictures(other, camera, [p[:30, :40] for p in pictures(camera)], stamps(FRAMES))
    assert not is_unrectified(other)
    write_raw_calib(drive.parent, RIG, rectified=rectification(RIG))  # both of one size
    for camera in (0, 1):
        write_pictures(other, camera, pictures(camera), stamps(FRAMES))
    assert not is_unrectified(other)


def write_calibrated_imu(drive):
    mounted = {"R": np.eye(3), "T": np.array([-0.8, 0.3, -0.8])}
    (drive.parent / "calib_imu_to_velo.txt").write_text(key_values_text(mounted))


def test_a_rectified_drive_beside_it_is_the_one_that_is_meant(drive):
    shutil.copytree(drive, drive.with_name(DRIVE.replace("extract", "sync")))
    assert isinstance(recognise(str(drive.parent)), KittiRaw)
    assert isinstance(recognise(str(drive)), KittiExtract)
    assert len(KittiExtract(str(drive.parent)).open().ids) == FRAMES
    with pytest.raises(NotRectified, match="kitti-extract"):
        KittiRaw(str(drive)).open()


def test_broken_drives_are_named(drive, tmp_path):
    with pytest.raises(SourceUnknown):
        KittiExtract(str(tmp_path / "nothing")).open()
    path = drive.parent / "calib_cam_to_cam.txt"
    text = path.read_text()
    path.write_text("".join(line + "\n" for line in text.splitlines() if "D_01" not in line))
    with pytest.raises(CalibrationField, match="D_01"):
        KittiExtract(str(drive)).open()
    path.write_text(text.replace("R_01: ", "R_01: -"))
    with pytest.raises(CalibrationValue, match="R_01 is no rotation"):
        KittiExtract(str(drive)).open()
    path.unlink()
    with pytest.raises(CalibrationMissing):
        KittiExtract(str(drive)).open()
    path.write_text(text)
    (drive / "image_00" / "timestamps.txt").write_text("2026-01-02 10:00:00.0\nnever\n")
    with pytest.raises(SequenceTime, match="never"):
        KittiExtract(str(drive)).open()


@pytest.mark.real
def test_the_real_drive(real_data):
    source = KittiExtract(str(real_data / "kitti_raw_unrectified"), scan_offset=2).open()
    assert source.ids[:3] == ("0000000029", "0000000031", "0000000033")
    assert len(source.ids) == 8
    pair = source.load(2)
    assert pair.left.shape == (512, 1392)
    assert len(pair.scan) == 120_390
    assert pair.timestamp_ns % 1_000_000_000 == 903_792_640
    assert np.linalg.norm(pair.rig.T_right_left.translation_m) == pytest.approx(0.53717, abs=1e-5)


def test_scans_of_other_numbers_are_worded():
    assert [numbered(offset) for offset in (0, 2, -3)] == ["n", "n - 2", "n + 3"]
