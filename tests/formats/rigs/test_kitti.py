"""KITTI calibrations: exact rigs from real files, round trips, and every way to break a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
    CalibrationValue,
    LimitError,
)
from pseudolidar.formats.limits import Limits
from pseudolidar.formats.rigs.kitti import (
    CAM_TO_CAM,
    IMU_TO_VELO,
    VELO_TO_CAM,
    read_object_calib,
    read_odometry_calib,
    read_raw_calib,
    write_object_calib,
    write_odometry_calib,
    write_raw_calib,
)
from pseudolidar.formats.rigs.kitti_calibration import COLOUR, GREY
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

SIZE_PX = (1242, 375)
K = "7.2e+02 0 6.1e+02 {} 0 7.2e+02 1.7e+02 {} 0 0 1 {}"
OBJECT = {
    "P0": K.format(0, 0, 0),
    "P1": K.format(-387.5, 0, 0),
    "P2": K.format(44.8, 0.2, 0.0027),
    "P3": K.format(-339.5, 2.2, 0.0027),
    "R0_rect": "1 0 0 0 1 0 0 0 1",
    "Tr_velo_to_cam": "0 -1 0 0.01 0 0 -1 -0.08 1 0 0 -0.27",
    "Tr_imu_to_velo": "1 0 0 -0.8 0 1 0 0.3 0 0 1 -0.8",
}


def object_file(tmp_path: Path, **changes: str | None) -> Path:
    fields = {key: value for key, value in (OBJECT | changes).items() if value is not None}
    path = tmp_path / "000001.txt"
    path.write_text("".join(f"{key}: {value}\n" for key, value in fields.items()))
    return path


def any_rig() -> StereoRig:
    """A rectified rig with digits that a short notation would lose."""
    matrix = np.array(
        [[721.5377123456789, 0, 609.5593], [0, 721.5377123456789, 172.854], [0, 0, 1]]
    )
    angle = 0.0123456789012345
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[s, -c, 0.0], [0.0, 0.0, -1.0], [c, s, 0.0]])
    return StereoRig(
        left=Camera(matrix, *SIZE_PX, frame="camera_left"),
        right=Camera(matrix, *SIZE_PX, frame="camera_right"),
        T_right_left=Pose.from_rotation(
            "camera_right", "camera_left", np.eye(3), np.array([-0.5327254279298227, 1e-3, -2e-5])
        ),
        T_left_velodyne=Pose.from_rotation(
            "camera_left", "velodyne", R, np.array([1 / 300, -0.0754667185, -0.269386912])
        ),
        T_velodyne_imu=Pose.from_rotation(
            "velodyne", "imu", np.eye(3), np.array([-0.8086759, 1 / 3, -0.7997231])
        ),
    )


def assert_same_rig(a: StereoRig, b: StereoRig) -> None:
    # K and the Velodyne come back bit by bit; t = K^-1 (K t) to rounding.
    np.testing.assert_array_equal(a.left.K, b.left.K)
    np.testing.assert_array_equal(a.right.K, b.right.K)
    np.testing.assert_allclose(a.T_right_left.matrix, b.T_right_left.matrix, atol=1e-14)
    np.testing.assert_array_equal(a.T_left_velodyne.matrix, b.T_left_velodyne.matrix)


# --- what a good file means ----------------------------------------------------------------------


def test_offsets_of_the_cameras_are_exact(tmp_path):
    calibration = read_object_calib(object_file(tmp_path))
    rig = calibration.rig(COLOUR, size_px=SIZE_PX)
    point_cam0 = np.array([1.0, -2.0, 15.0])
    for number, P in ((2, rig.P_left), (3, rig.P_right)):
        file_P = calibration.projections[number]
        in_left = calibration.T_left_cam0(2).apply(point_cam0[None])[0]
        np.testing.assert_allclose(P @ [*in_left, 1], file_P @ [*point_cam0, 1], rtol=1e-13)
    # The third row moves the camera along its axis: 2.7 mm.
    assert calibration.T_left_cam0(2).translation_m[2] == 0.0027
    assert rig.baseline_m == pytest.approx((44.8 + 339.5) / 720, abs=1e-15)


def test_velodyne_reaches_the_left_camera_through_the_rectification(tmp_path):
    c, s = np.cos(0.01), np.sin(0.01)
    R0 = f"{c} {-s} 0 {s} {c} 0 0 0 1"
    calibration = read_object_calib(object_file(tmp_path, R0_rect=R0))
    rig = calibration.rig(COLOUR, size_px=SIZE_PX)
    point = np.array([10.0, 2.0, -1.0, 1.0])
    Tr = np.fromstring(OBJECT["Tr_velo_to_cam"], sep=" ").reshape(3, 4)
    rectified = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ Tr @ point
    expected = calibration.projections[2] @ [*rectified, 1]
    got = rig.P_left @ rig.T_left_velodyne.matrix @ point
    np.testing.assert_allclose(got, expected, rtol=1e-12)
    assert (rig.T_velodyne_imu.dst, rig.T_velodyne_imu.src) == ("velodyne", "imu")


def test_tracking_calibration_without_colons(tmp_path):
    path = tmp_path / "0000.txt"
    names = {"R0_rect": "R_rect", "Tr_velo_to_cam": "Tr_velo_cam", "Tr_imu_to_velo": "Tr_imu_velo"}
    lines = [
        f"{key}: {value}" if key.startswith("P") else f"{names[key]} {value}"
        for key, value in OBJECT.items()
    ]
    path.write_text("\n".join(lines) + "\n")
    rig = read_object_calib(path).rig(COLOUR, size_px=SIZE_PX)
    same = read_object_calib(object_file(tmp_path)).rig(COLOUR, size_px=SIZE_PX)
    assert_same_rig(rig, same)


@pytest.mark.parametrize(
    "dressed",
    [
        lambda text: b"\xef\xbb\xbf" + text.encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
        lambda text: text.replace("\n", "  \t\n\n").encode() + b"\n \n",
        lambda text: text.encode() + "note: Stra\xdfe\n".encode("latin-1"),
        lambda text: text.rstrip("\n").encode(),
    ],
    ids=["byte-order mark", "CR LF", "blanks", "Latin-1", "no last line end"],
)
def test_harmless_dress_of_a_text_file(tmp_path, dressed):
    path = object_file(tmp_path)
    expected = read_object_calib(path).rig(COLOUR, size_px=SIZE_PX)
    path.write_bytes(dressed(path.read_text()))
    assert_same_rig(read_object_calib(path).rig(COLOUR, size_px=SIZE_PX), expected)


def test_object_round_trip(tmp_path):
    rig = any_rig()
    write_object_calib(tmp_path / "000000.txt", rig)
    calibration = read_object_calib(tmp_path / "000000.txt")
    for pair in (GREY, COLOUR):
        assert_same_rig(calibration.rig(pair, size_px=SIZE_PX), rig)
        np.testing.assert_array_equal(calibration.T_left_cam0(pair[0]).matrix, np.eye(4))
    np.testing.assert_array_equal(calibration.T_velodyne_imu.matrix, rig.T_velodyne_imu.matrix)


def test_odometry_round_trip(tmp_path):
    rig = any_rig()
    write_odometry_calib(tmp_path / "calib.txt", rig)
    assert_same_rig(read_odometry_calib(tmp_path / "calib.txt").rig(GREY, size_px=SIZE_PX), rig)


def test_raw_round_trip(tmp_path):
    rig = any_rig()
    write_raw_calib(tmp_path, rig, calib_time="09-Jan-2012 13:57:47")
    files = (tmp_path / name for name in (CAM_TO_CAM, VELO_TO_CAM, IMU_TO_VELO))
    calibration = read_raw_calib(*files)
    assert_same_rig(calibration.rig(COLOUR), rig)
    np.testing.assert_array_equal(calibration.T_velodyne_imu.matrix, rig.T_velodyne_imu.matrix)
    assert calibration.sizes_px[2] == SIZE_PX
    assert "made 09-Jan-2012 13:57:47" in calibration.rig(COLOUR).origin


def test_odometry_without_velodyne(tmp_path):
    path = object_file(tmp_path, R0_rect=None, Tr_velo_to_cam=None, Tr_imu_to_velo=None)
    rig = read_odometry_calib(path).rig(COLOUR, size_px=SIZE_PX)
    assert rig.T_left_velodyne is None


# --- what a bad file is told ---------------------------------------------------------------------


@pytest.mark.parametrize("key", ["P2", "P3", "Tr_velo_to_cam", "R0_rect"])
def test_missing_key_names_what_is_there(tmp_path, key):
    path = object_file(tmp_path, **{key: None})
    with pytest.raises(CalibrationField) as caught:
        read_object_calib(path).rig(COLOUR, size_px=SIZE_PX)
    error = caught.value
    assert error.path == str(path)
    assert key in error.want
    assert "P0" in error.got
    assert "raw" in error.fix
    assert "odometry" in error.fix


def test_imu_may_be_missing(tmp_path):
    path = object_file(tmp_path, Tr_imu_to_velo=None)
    assert read_object_calib(path).T_velodyne_imu is None


@pytest.mark.parametrize("numbers", [11, 13])
def test_wrong_count_names_line_and_counts(tmp_path, numbers):
    words = (OBJECT["P2"] + " 5").split()[:numbers]
    with pytest.raises(CalibrationSyntax) as caught:
        read_object_calib(object_file(tmp_path, P2=" ".join(words)))
    assert caught.value.where == "line 3"
    assert f"{numbers} numbers" in caught.value.got
    assert caught.value.want == "12"


@pytest.mark.parametrize(
    "word",
    [
        *("nan", "inf", "-Infinity", "1_000", "7,2e2", "0x10", "1e", "--5", "1e999", "abc", "."),
        *("\uff17\uff12\uff10", "7\u00a02", "\u2212720"),  # full-width, no-break space, minus sign
    ],
)
def test_what_is_no_plain_number_is_refused_by_line_and_column(tmp_path, word):
    changed = OBJECT["P2"].replace("44.8", word)
    with pytest.raises(CalibrationSyntax) as caught:
        read_object_calib(object_file(tmp_path, P2=changed))
    assert caught.value.where == f"line 3, column {len('P2: 7.2e+02 0 6.1e+02 ') + 1}"


@pytest.mark.parametrize("word", ["+44.8", "44.8e0", "44.80000", "448E-1", "4.48e+01"])
def test_every_form_of_a_plain_number_is_read(tmp_path, word):
    path = object_file(tmp_path, P2=OBJECT["P2"].replace("44.8", word))
    assert read_object_calib(path).projections[2][0, 3] == 44.8


def test_duplicate_key_names_both_lines(tmp_path):
    path = object_file(tmp_path)
    path.write_text(path.read_text() + f"P2: {OBJECT['P2']}\n")
    with pytest.raises(CalibrationField, match="lines 3 and 8"):
        read_object_calib(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("R0_rect", "1 0 0 0 1 0 0 0 1.002"),
        ("R0_rect", "1 0 0 0 1 0 0 0 -1"),
        ("Tr_velo_to_cam", "0 -1 0 0 0 0 -1 0 0.5 0 0 0"),
        ("Tr_imu_to_velo", "1 0.01 0 0 0 1 0 0 0 0 1 0"),
    ],
    ids=["stretched", "mirrored", "shrunk", "skewed"],
)
def test_no_rotation_is_refused_with_its_value(tmp_path, key, value):
    with pytest.raises(CalibrationValue, match="no rotation") as caught:
        read_object_calib(object_file(tmp_path, **{key: value}))
    assert caught.value.where == f"{key}, line {list(OBJECT).index(key) + 1}"
    assert key in caught.value.got


def test_slightly_wrong_rotation_is_noted(tmp_path):
    path = object_file(tmp_path, R0_rect="1 0.0001 0 0 1 0 0 0 1")
    assert "R0_rect is a rotation only to 0.0001" in read_object_calib(path).notes[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"P2": OBJECT["P3"], "P3": OBJECT["P2"]}, "stands right of the other"),
        ({"P3": OBJECT["P2"]}, "baseline 0: both"),
        ({"P2": OBJECT["P2"].replace("7.2e+02", "-7.2e+02")}, "focal lengths"),
        ({"P2": OBJECT["P2"].replace("6.1e+02", "6.1e+03")}, "principal point"),
        ({"P2": "0 0 0 0 0 0 0 0 0 0 0 0"}, "no projection"),
    ],
    ids=["swapped", "no baseline", "negative focal length", "outside", "zeros"],
)
def test_impossible_values_name_the_file(tmp_path, changes, message):
    path = object_file(tmp_path, **changes)
    with pytest.raises(CalibrationValue, match=message) as caught:
        read_object_calib(path).rig(COLOUR, size_px=SIZE_PX)
    assert caught.value.path == str(path)


def test_missing_file(tmp_path):
    with pytest.raises(CalibrationMissing):
        read_object_calib(tmp_path / "absent.txt")
    with pytest.raises(CalibrationMissing):
        read_odometry_calib(tmp_path / "absent.txt")


def test_oversized_and_binary_files_are_refused(tmp_path):
    path = object_file(tmp_path)
    with pytest.raises(LimitError):
        read_object_calib(path, limits=Limits(text_bytes=100))
    path.write_bytes(path.read_text().encode("utf-16"))
    with pytest.raises(CalibrationSyntax, match="zero byte") as caught:
        read_object_calib(path)
    assert caught.value.where == "byte 3"


def test_line_without_a_key(tmp_path):
    path = object_file(tmp_path)
    path.write_text(path.read_text() + "7.2 0 0\n")
    with pytest.raises(CalibrationSyntax) as caught:
        read_object_calib(path)
    assert caught.value.where == "line 8, column 1"


def test_cut_anywhere_never_gives_another_rig(tmp_path):
    path = object_file(tmp_path)
    text = path.read_text()
    whole = read_object_calib(path).rig(COLOUR, size_px=SIZE_PX)
    refused = 0
    for size in range(0, len(text), 7):
        path.write_text(text[:size])
        try:
            rig = read_object_calib(path).rig(COLOUR, size_px=SIZE_PX)
        except (CalibrationField, CalibrationSyntax):
            refused += 1
            continue
        assert_same_rig(rig, whole)
    assert refused > 40


# --- real files ----------------------------------------------------------------------------------


@pytest.mark.real
def test_real_baselines(real_data):
    raw = real_data / "kitti_raw" / "2011_09_26"
    files = [raw / name for name in (CAM_TO_CAM, VELO_TO_CAM, IMU_TO_VELO)]
    stereo = real_data / "kitti_stereo2015" / "training"
    folders = ("calib_cam_to_cam", "calib_velo_to_cam", "calib_imu_to_velo")
    of_object = real_data / "kitti_object" / "training" / "calib" / "000013.txt"
    rigs = [
        read_raw_calib(*files).rig(COLOUR),
        read_raw_calib(*(stereo / name / "000013.txt" for name in folders)).rig(COLOUR),
        read_object_calib(of_object).rig(COLOUR, size_px=SIZE_PX),
    ]
    for rig in rigs:
        assert rig.baseline_m == pytest.approx(0.53273, abs=5e-6)
        assert rig.left.focal_px == 721.5377
        assert rig.is_rectified
        np.testing.assert_allclose(
            rig.T_left_velodyne.matrix, rigs[0].T_left_velodyne.matrix, atol=1e-9
        )
    odometry = read_odometry_calib(real_data / "kitti_odometry" / "sequences" / "06" / "calib.txt")
    grey = odometry.rig(GREY, size_px=(1226, 370))
    assert grey.baseline_m == pytest.approx(0.53715, abs=5e-6)
    assert grey.left.focal_px == 707.0912


@pytest.mark.real
def test_real_rows_without_keys_are_read_and_said(real_data):
    odd = real_data / "odd_formats" / "odometry_calib_without_labels.txt"
    calibration = read_odometry_calib(odd)
    assert calibration.rig(GREY, size_px=(1226, 370)).baseline_m == pytest.approx(0.53715, abs=5e-6)
    assert "P0, P1" in calibration.notes[0]
    with pytest.raises(CalibrationField, match="no P2; found P0, P1"):
        calibration.rig(COLOUR, size_px=(1226, 370))
