"""The KITTI sources on small data sets written by our own writers, whole and broken."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSizeMismatch,
    CalibrationSyntax,
    ImageMissing,
    ImageTruncated,
    LabelError,
    NotRectified,
    PairMismatch,
    PointFileTruncated,
    PoseFileError,
    SequenceTime,
    SourceEmpty,
    SourceUnknown,
    UsageError,
)
from pseudolidar.formats.labels import write_labels
from pseudolidar.formats.oxts import OxtsPacket, packet_at, write_oxts
from pseudolidar.formats.pictures.disparity_png import write_disparity_png
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.velodyne_bin import write_velodyne_bin
from pseudolidar.formats.rigs.kitti import write_object_calib, write_odometry_calib, write_raw_calib
from pseudolidar.formats.timestamps import write_times, write_timestamps
from pseudolidar.formats.trajectory import camera_poses, write_kitti_poses
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.sources.kitti.object import KittiObject
from pseudolidar.sources.kitti.odometry import KittiOdometry
from pseudolidar.sources.kitti.raw import KittiRaw
from pseudolidar.sources.kitti.stereo import KittiStereo
from pseudolidar.sources.other_rig import calibration_date, with_rig
from pseudolidar.structures.box import Box3D, Detection, Label
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import LidarScan
from pseudolidar.structures.pose import Pose

WIDTH, HEIGHT = 64, 48
FRAMES = 5
START_NS = 1_700_000_000_123_456_789
STEP_NS = 100_000_003
DRIVE = "2026_01_02_drive_0007_sync"
FIRST_OXTS = OxtsPacket(49.0, 8.4, 116.0, 0.01, -0.02, 0.7)


def make_rig() -> StereoRig:
    K = np.array([[50.0, 0, 31.5], [0, 50.0, 23.5], [0, 0, 1]])
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    return StereoRig(
        left=Camera(K, WIDTH, HEIGHT, frame="camera_left"),
        right=Camera(K, WIDTH, HEIGHT, frame="camera_right"),
        T_right_left=Pose.from_rotation(
            "camera_right", "camera_left", np.eye(3), np.array([-0.5, 0, 0])
        ),
        T_left_velodyne=Pose.from_rotation(
            "camera_left", "velodyne", axes, np.array([0.0, -0.1, -0.3])
        ),
        T_velodyne_imu=Pose.from_rotation(
            "velodyne", "imu", np.eye(3), np.array([-0.8, 0.3, -0.8])
        ),
    )


def body_path() -> tuple[Pose, ...]:
    poses = []
    for index in range(FRAMES):
        c, s = np.cos(0.05 * index), np.sin(0.05 * index)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        poses.append(
            Pose.from_rotation("map", "base_link", R, np.array([1.3 * index, 0.1 * index, 0.0]))
        )
    return tuple(poses)


def scan() -> LidarScan:
    xyz = np.arange(30, dtype=np.float32).reshape(10, 3) + 1
    return LidarScan(xyz, np.linspace(0, 1, 10, dtype=np.float32))


def pictures(folder: Path, seed: int, names: list[str], *, grey: bool = False) -> None:
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    shape = (HEIGHT, WIDTH) if grey else (HEIGHT, WIDTH, 3)
    for name in names:
        pixels = rng.integers(0, 255, shape, dtype=np.uint8)
        (folder / f"{name}.png").write_bytes(encode_png(pixels))


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    drive = tmp_path / "2026_01_02" / DRIVE
    names = [f"{n:010d}" for n in range(FRAMES)]
    stamps = [START_NS + n * STEP_NS for n in range(FRAMES)]
    for camera in (2, 3):
        pictures(drive / f"image_0{camera}" / "data", camera, names)
        write_timestamps(drive / f"image_0{camera}" / "timestamps.txt", stamps)
    for name, pose in zip(names, body_path(), strict=True):
        write_velodyne_bin(drive / "velodyne_points" / "data" / f"{name}.bin", scan())
        write_oxts(drive / "oxts" / "data" / f"{name}.txt", packet_at(pose, FIRST_OXTS))
    write_timestamps(drive / "velodyne_points" / "timestamps.txt", [stamp - 7 for stamp in stamps])
    write_raw_calib(drive.parent, make_rig())
    return drive


@pytest.fixture
def odometry(tmp_path: Path) -> Path:
    rig, folder = make_rig(), tmp_path / "sequences" / "03"
    names = [f"{n:06d}" for n in range(FRAMES)]
    for camera in (0, 1):
        pictures(folder / f"image_{camera}", camera, names, grey=True)
    write_odometry_calib(folder / "calib.txt", rig)
    write_times(folder / "times.txt", [n * STEP_NS for n in range(FRAMES)])
    for name in names:
        write_velodyne_bin(folder / "velodyne" / f"{name}.bin", scan())
    T_velodyne_left = left_in_base_link(
        StereoRig(rig.left, rig.right, rig.T_right_left, rig.T_left_velodyne)
    )
    poses = camera_poses(body_path(), Pose("base_link", "camera_0", T_velodyne_left.matrix))
    write_kitti_poses(tmp_path / "poses" / "03.txt", poses)
    return folder


def a_label() -> Label:
    R = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    centre = Pose.from_rotation("camera_left", "box", R, np.array([1.0, 0.5, 12.0]))
    return Label(Detection("Car", (10, 11, 20, 21)), Box3D(centre, 4.0, 1.7, 1.5), 0.0, 0)


@pytest.fixture
def objects(tmp_path: Path) -> Path:
    root = tmp_path / "training"
    names = ["000002", "000010", "000011"]
    for camera in (2, 3):
        pictures(root / f"image_{camera}", camera, names)
    for name in names:
        write_object_calib(root / "calib" / f"{name}.txt", make_rig())
        write_labels(root / "label_2" / f"{name}.txt", [a_label()])
        write_velodyne_bin(root / "velodyne" / f"{name}.bin", scan())
    return root


@pytest.fixture
def stereo2012(tmp_path: Path) -> Path:
    root = tmp_path / "training"
    names = [f"{n:06d}_{instant}" for n in (3, 4) for instant in (10, 11)]
    for camera in (0, 1):
        pictures(root / f"image_{camera}", camera, names, grey=True)
        pictures(root / f"colored_{camera}", camera + 2, names)
    for n in (3, 4):
        write_odometry_calib(root / "calib" / f"{n:06d}.txt", make_rig())
        values = np.full((HEIGHT, WIDTH), n, np.float32)
        write_disparity_png(root / "disp_occ" / f"{n:06d}_10.png", DisparityMap(values))
        write_disparity_png(root / "disp_noc" / f"{n:06d}_10.png", DisparityMap(values + 1))
    return root


# --- what was written is read --------------------------------------------------------------------


def test_raw_drive_comes_back(raw):
    source = KittiRaw(str(raw.parent.parent)).open()
    assert source.timestamps_ns == tuple(START_NS + n * STEP_NS for n in range(FRAMES))
    assert source.summary.absent == ("grey cameras (image_00, image_01)",)
    for index, pose in enumerate(body_path()):
        frame = source.load(index)
        # Mercator's metres are around 6e6: a double has steps of 1e-9 m there.
        np.testing.assert_allclose(frame.pose.matrix, pose.matrix, atol=1e-8)
        assert frame.scan.timestamp_ns == START_NS + index * STEP_NS - 7
    np.testing.assert_array_equal(frame.scan.xyz, scan().xyz)
    assert frame.rig.baseline_m == pytest.approx(0.5, abs=1e-15)


def test_odometry_sequence_comes_back(odometry):
    source = KittiOdometry(str(odometry)).open()
    # Stamps of 0 mean "none" to other tools.
    expected = tuple(1_000_000_000 + n * STEP_NS for n in range(FRAMES))
    assert source.timestamps_ns == expected
    assert any("plus 1 s" in note for note in source.summary.notes)
    for index, pose in enumerate(body_path()):
        np.testing.assert_allclose(source.load(index).pose.matrix, pose.matrix, atol=1e-12)
    assert source.load(0).scan is not None


def test_object_data_comes_back(objects):
    source = KittiObject(str(objects.parent)).open()
    assert source.ids == ("000002", "000010", "000011")
    assert source.summary.absent == ()
    frame = source.load(2)
    (label,) = frame.labels
    np.testing.assert_allclose(label.box.pose.matrix, a_label().box.pose.matrix, atol=1e-14)
    assert (label.box.length_m, label.box.width_m, label.box.height_m) == (4.0, 1.7, 1.5)
    assert frame.scan is not None


def test_stereo_2012_cameras_instants_and_truth(stereo2012):
    source = KittiStereo(str(stereo2012.parent)).open()
    assert source.ids == ("000003_10", "000004_10")
    frame = source.load(1)
    assert frame.left.ndim == 3
    assert frame.truth.values[0, 0] == 4
    grey = KittiStereo(str(stereo2012), camera="grey", instants=(10, 11), truth="noc").open()
    assert grey.ids == ("000003_10", "000003_11", "000004_10", "000004_11")
    assert grey.load(0).left.ndim == 2
    assert grey.load(0).truth.values[0, 0] == 4
    assert grey.load(1).truth is None
    with pytest.raises(SourceEmpty, match="instants"):
        KittiStereo(str(stereo2012), instants=(12,)).open()


def test_colour_is_taken_where_it_is_there_and_calibrated(odometry):
    names = [f"{n:06d}" for n in range(FRAMES)]
    for camera in (2, 3):
        pictures(odometry / f"image_{camera}", camera, names)
    assert KittiOdometry(str(odometry)).open().cameras == (2, 3)
    assert KittiOdometry(str(odometry), camera="grey").open().cameras == (0, 1)
    calib = odometry / "calib.txt"
    lines = [line for line in calib.read_text().splitlines() if line[:2] not in ("P2", "P3")]
    calib.write_text("\n".join(lines))
    assert KittiOdometry(str(odometry)).open().cameras == (0, 1)
    with pytest.raises(CalibrationField, match="no P2; found P0, P1"):
        KittiOdometry(str(odometry), camera="colour").open()


# --- pairing -------------------------------------------------------------------------------------


def test_missing_eye_is_refused_and_nothing_shifts(raw):
    (raw / "image_03" / "data" / "0000000002.png").unlink()
    whole = KittiRaw(str(raw)).open()
    assert whole.ids == ("0000000000", "0000000001", "0000000003", "0000000004")
    ((name, error),) = whole.refused
    assert name == "0000000002"
    assert isinstance(error, ImageMissing)
    assert "0000000001.png" in error.fix
    assert error.path == str(raw / "image_03" / "data" / "0000000002.png")
    assert whole.timestamps_ns[2] == START_NS + 3 * STEP_NS
    frame = whole.load(2)
    assert frame.scan.timestamp_ns == START_NS + 3 * STEP_NS - 7
    np.testing.assert_allclose(frame.pose.matrix, body_path()[3].matrix, atol=1e-8)


def test_missing_left_eye_is_refused_too(raw):
    (raw / "image_02" / "data" / "0000000000.png").unlink()
    source = KittiRaw(str(raw)).open()
    assert source.ids[0] == "0000000001"
    assert "no left image" in source.refused[0][1].got
    # `map` is at the first frame that is there.
    np.testing.assert_allclose(source.load(0).pose.matrix, np.eye(4), atol=1e-9)


def test_order_is_numeric_and_mixed_widths_are_noted(odometry):
    for camera in (0, 1):
        folder = odometry / f"image_{camera}"
        for n in range(FRAMES):
            (folder / f"{n:06d}.png").rename(folder / f"{n * 3}.png")
    (odometry / "image_1" / "12.png").rename(odometry / "image_1" / "000012.png")
    for name in ("times.txt", "../../poses/03.txt"):
        (odometry / name).unlink()
    source = KittiOdometry(str(odometry)).open()
    assert source.ids == ("0", "3", "6", "9", "12")
    assert any("different widths" in note for note in source.summary.notes)
    # Numbers of a sequence are its time.
    assert source.timestamps_ns[1] == 1_300_000_000


def test_two_files_of_one_number_are_not_guessed(odometry):
    data = (odometry / "image_0" / "000001.png").read_bytes()
    (odometry / "image_0" / "1.png").write_bytes(data)
    source = KittiOdometry(str(odometry)).open()
    assert source.ids[1] == "000001"
    assert [error.code for _, error in source.refused] == ["PairMismatch"]


def test_files_without_a_number_are_left_out_and_named(odometry):
    (odometry / "image_0" / "preview.png").write_bytes(b"x")
    (odometry / "image_0" / "000001.png.part").write_bytes(b"x")
    source = KittiOdometry(str(odometry)).open()
    assert len(source.ids) == FRAMES
    assert any("preview.png" in note for note in source.summary.notes)


# --- partial downloads ---------------------------------------------------------------------------


def test_scans_and_packets_may_be_missing(raw):
    (raw / "velodyne_points" / "data" / "0000000001.bin").unlink()
    for n in (0, 4):
        (raw / "oxts" / "data" / f"{n:010d}.txt").unlink()
    source = KittiRaw(str(raw)).open()
    assert source.summary.absent[1:] == ("velodyne of 1 of 5 frames", "oxts of 2 of 5 frames")
    assert source.load(1).scan is None
    assert source.load(0).pose is None
    np.testing.assert_allclose(source.load(1).pose.matrix, np.eye(4), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "has_scan", "has_pose"),
    [("calib_velo_to_cam.txt", False, False), ("calib_imu_to_velo.txt", True, False)],
)
def test_missing_calibration_of_a_sensor_leaves_it_out(raw, name, has_scan, has_pose):
    (raw.parent / name).unlink()
    source = KittiRaw(str(raw)).open()
    assert f"calibration {name}" in source.summary.absent
    frame = source.load(1)
    assert (frame.scan is not None, frame.pose is not None) == (has_scan, has_pose)


def test_missing_camera_calibration_is_fatal(raw):
    (raw.parent / "calib_cam_to_cam.txt").unlink()
    with pytest.raises(CalibrationMissing, match="separate download"):
        KittiRaw(str(raw)).open()


def test_labels_and_calibrations_may_be_missing(objects):
    (objects / "label_2" / "000002.txt").unlink()
    (objects / "label_2" / "000099.txt").write_text("")
    (objects / "calib" / "000010.txt").unlink()
    source = KittiObject(str(objects)).open()
    assert source.ids == ("000002", "000011")
    assert [(name, error.code) for name, error in source.refused] == [
        ("000010", "CalibrationMissing")
    ]
    assert source.summary.absent == ("labels of 1 of 3 frames",)
    assert any("000099.txt" in note for note in source.summary.notes)
    assert source.load(0).labels is None


def test_data_set_without_calibrations(objects):
    for path in (objects / "calib").iterdir():
        path.unlink()
    with pytest.raises(CalibrationMissing):
        KittiObject(str(objects)).open()


def test_one_camera_only(objects):
    for path in (objects / "image_3").iterdir():
        path.unlink()
    with pytest.raises(SourceEmpty, match="image_2 3, image_3 0"):
        KittiObject(str(objects)).open()


# --- sequences -----------------------------------------------------------------------------------


def test_several_sequences_need_a_choice(raw):
    other = raw.with_name("2026_01_02_drive_0011_sync")
    for camera in (2, 3):
        pictures(other / f"image_0{camera}" / "data", camera, ["0000000000"])
    root = str(raw.parent.parent)
    with pytest.raises(UsageError, match=r"drive_0007_sync, 2026_01_02_drive_0011_sync"):
        KittiRaw(root).open()
    for name in ("0011", "11", "2026_01_02_drive_0011_sync", "2026_01_02_drive_0011"):
        assert len(KittiRaw(root, sequence=name).open().ids) == 1
    with pytest.raises(UsageError, match="no drive '12'"):
        KittiRaw(root, sequence="12").open()


def test_odometry_sequence_by_number(odometry):
    for camera in (0, 1):
        pictures(odometry.with_name("10") / f"image_{camera}", camera, ["000000"], grey=True)
    write_odometry_calib(odometry.with_name("10") / "calib.txt", make_rig())
    root = str(odometry.parent.parent)
    assert len(KittiOdometry(root, sequence="3").open().ids) == FRAMES
    assert len(KittiOdometry(root, sequence="10").open().ids) == 1
    with pytest.raises(UsageError, match="03, 10"):
        KittiOdometry(root).open()


def test_what_is_nothing_is_unknown(tmp_path):
    for kind in (KittiRaw, KittiObject, KittiOdometry, KittiStereo):
        with pytest.raises(SourceUnknown):
            kind(str(tmp_path)).open()
        with pytest.raises(SourceUnknown):
            kind(str(tmp_path / "absent")).open()


def test_unrectified_pictures_are_seen_by_their_size(raw):
    path = raw.parent / "calib_cam_to_cam.txt"
    text = path.read_text()
    text = text.replace(f"S_02: {WIDTH}.0 {HEIGHT}.0", "S_02: 80.0 60.0")
    path.write_text(text)
    assert len(KittiRaw(str(raw)).open().ids) == FRAMES
    text = text.replace(f"S_rect_02: {WIDTH}.0 {HEIGHT}.0", "S_rect_02: 60.0 40.0")
    path.write_text(text.replace("S_02: 80.0 60.0", f"S_02: {WIDTH}.0 {HEIGHT}.0"))
    with pytest.raises(NotRectified):
        KittiRaw(str(raw)).open()


def test_calibration_of_another_date_is_noted(raw):
    moved = raw.parent.with_name("2026_01_03")
    raw.parent.rename(moved)
    source = KittiRaw(str(moved / DRIVE)).open()
    assert any("2026_01_03" in note for note in source.summary.notes)
    assert calibration_date(source.rig.origin) == datetime.date(2026, 1, 3)


def test_rig_of_another_day_is_warned(raw):
    source = KittiRaw(str(raw)).open()
    assert calibration_date(source.rig.origin) == datetime.date(2026, 1, 2)
    other = replace(source.rig, origin="refined on 2026_02_01")
    for rig, warned in ((source.rig, False), (other, True)):
        notes = with_rig(source, rig).summary.notes
        assert any("warning" in note for note in notes) == warned


# --- times ---------------------------------------------------------------------------------------


def stamp_lines(raw: Path) -> tuple[Path, list[str]]:
    path = raw / "image_02" / "timestamps.txt"
    return path, path.read_text().splitlines()


@pytest.mark.parametrize("other", [1, 0], ids=["equal", "backwards"])
def test_times_that_do_not_increase_are_refused_by_index(raw, other):
    path, lines = stamp_lines(raw)
    lines[2] = lines[other]
    path.write_text("\n".join(lines))
    with pytest.raises(SequenceTime) as caught:
        KittiRaw(str(raw)).open()
    assert caught.value.where == "index 2"
    assert caught.value.path == str(path)


def test_too_few_times_are_refused(raw):
    path, lines = stamp_lines(raw)
    path.write_text("\n".join(lines[:3]))
    with pytest.raises(SequenceTime, match="3 stamps") as caught:
        KittiRaw(str(raw)).open()
    assert caught.value.where == "index 3"


def test_blank_line_holds_the_place_of_a_missing_frame(raw):
    path, lines = stamp_lines(raw)
    path.write_text("\n".join([*lines[:2], "", *lines[3:]]))
    for camera in (2, 3):
        (raw / f"image_0{camera}" / "data" / "0000000002.png").unlink()
    assert KittiRaw(str(raw)).open().timestamps_ns[2] == START_NS + 3 * STEP_NS


def test_blank_lines_between_all_stamps_are_padding(raw):
    path, lines = stamp_lines(raw)
    path.write_text("\n\n".join(lines) + "\n\n")
    assert KittiRaw(str(raw)).open().timestamps_ns[4] == START_NS + 4 * STEP_NS


def test_gap_is_noted(raw):
    path, _ = stamp_lines(raw)
    write_timestamps(path, [START_NS + n * STEP_NS for n in (0, 1, 2, 9, 10)])
    source = KittiRaw(str(raw)).open()
    assert any("gap" in note and "index 3" in note for note in source.summary.notes)


def test_without_times_they_are_synthetic_and_said_so(raw):
    stamp_lines(raw)[0].unlink()
    source = KittiRaw(str(raw), rate_hz=20.0).open()
    assert source.timestamps_ns[:2] == (1_000_000_000, 1_050_000_000)
    assert any("synthetic" in note for note in source.summary.notes)
    with pytest.raises(UsageError):
        KittiRaw(str(raw), rate_hz=0.0).open()


# --- poses ---------------------------------------------------------------------------------------


def test_fewer_poses_than_frames_are_refused_with_both_counts(odometry):
    path = odometry.parent.parent / "poses" / "03.txt"
    path.write_text("\n".join(path.read_text().splitlines()[:3]))
    with pytest.raises(PoseFileError, match="3 poses; wanted at least 5") as caught:
        KittiOdometry(str(odometry)).open()
    assert caught.value.where == "row 4"


def test_broken_pose_is_refused_by_line(odometry):
    path = odometry.parent.parent / "poses" / "03.txt"
    lines = path.read_text().splitlines()
    lines[3] = lines[3].replace(lines[3].split()[5], "nan", 1)
    path.write_text("\n".join(lines))
    with pytest.raises(PoseFileError, match="line 4"):
        KittiOdometry(str(odometry)).open()


# --- single frames -------------------------------------------------------------------------------


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def test_broken_file_costs_its_frame_alone(objects):
    cut(objects / "velodyne" / "000002.bin", 41)
    (objects / "calib" / "000010.txt").write_text("P2: 1 2\n")
    (objects / "label_2" / "000011.txt").write_text("Car 1 2\n")
    source = KittiObject(str(objects)).open()
    for index, (error, name) in enumerate(
        [
            (PointFileTruncated, "velodyne/000002.bin"),
            (CalibrationSyntax, "calib/000010.txt"),
            (LabelError, "label_2/000011.txt"),
        ]
    ):
        with pytest.raises(error) as caught:
            source.load(index)
        assert caught.value.path == str(objects / name)


def test_first_frame_broken_does_not_hide_the_others(objects):
    cut(objects / "image_2" / "000002.png", 300)
    (objects / "calib" / "000010.txt").write_text("P2: 1 2\n")
    source = KittiObject(str(objects)).open()
    assert source.rig.baseline_m == pytest.approx(0.5)
    with pytest.raises(ImageTruncated):
        source.load(0)
    assert source.load(2).id == "000011"


def test_all_calibrations_broken_is_said_at_once(objects):
    for path in (objects / "calib").iterdir():
        path.write_text(path.read_text().replace("P3:", "P9:"))
    with pytest.raises(CalibrationField, match="P3") as caught:
        KittiObject(str(objects)).open()
    assert caught.value.path == str(objects / "calib" / "000002.txt")


def test_eyes_of_different_size(raw):
    path = raw / "image_03" / "data" / "0000000001.png"
    path.write_bytes(encode_png(np.zeros((HEIGHT, WIDTH - 2, 3), np.uint8)))
    with pytest.raises(PairMismatch) as caught:
        KittiRaw(str(raw)).open().load(1)
    assert caught.value.path == str(raw / "image_02" / "data" / "0000000001.png")


def test_pictures_of_another_size_than_the_calibration(raw):
    for camera in (2, 3):
        path = raw / f"image_0{camera}" / "data" / "0000000001.png"
        path.write_bytes(encode_png(np.zeros((HEIGHT * 2, WIDTH * 2, 3), np.uint8)))
    source = KittiRaw(str(raw)).open()
    with pytest.raises(CalibrationSizeMismatch, match="128x96"):
        source.load(1)


def test_unknown_classes_are_noted(objects):
    path = objects / "label_2" / "000002.txt"
    path.write_text(path.read_text().replace("Car", "Dragon"))
    assert any("Dragon" in note for note in KittiObject(str(objects)).open().load(0).notes)


def test_odd_path_names(objects):
    odd = objects.parent / "d\u00e4ta \U0001f600 set"
    odd.mkdir()
    objects.rename(odd / "training")
    assert KittiObject.looks_like(odd)
    assert KittiObject(str(odd)).open().load(0).id == "000002"
