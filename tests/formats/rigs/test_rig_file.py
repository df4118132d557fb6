"""Calibrations of other programs: read right, units asked for, mistakes refused."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationUnits,
    CalibrationValue,
    NotRectified,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.rigs.k_txt import write_k_txt
from pseudolidar.formats.rigs.middlebury import read_middlebury_calib, write_middlebury_calib
from pseudolidar.formats.rigs.opencv_rig_writers import write_camera_info, write_opencv
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.rigs.rig_reading import unchanged
from pseudolidar.geometry.triangulation import points_by_p, points_by_q
from pseudolidar.structures.camera import Camera, StereoRig
from pseudolidar.structures.pose import Pose

SIZE = (640, 480)
FORMS = ("yml", "xml", "json")
LENS = np.array([0.1, -0.05, 0.001, 0.002, 0.01])


@functools.cache
def stereo() -> dict[str, np.ndarray]:
    """A stereo calibration with its rectification by OpenCV, lengths in millimetres."""
    K1 = np.array([[500.25, 0, 320.5], [0, 501.5, 240.25], [0, 0, 1]])
    K2 = np.array([[510.125, 0, 325.75], [0, 509.5, 235.5], [0, 0, 1]])
    R = cv2.Rodrigues(np.array([0.01, 0.02, 0.005]))[0]
    T = np.array([[-120.0], [1.0], [2.0]])
    R1, R2, P1, P2, Q = cv2.stereoRectify(K1, LENS, K2, LENS, SIZE, R, T, flags=0)[:5]
    names = ("M1", "D1", "M2", "D2", "R", "T", "R1", "R2", "P1", "P2", "Q")
    row = LENS.reshape(1, 5)
    return dict(zip(names, (K1, row, K2, row, R, T, R1, R2, P1, P2, Q), strict=True))


def by_opencv(path: Path, values: dict[str, object]) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    return path


def rig(*, doffs_px: float = 0.0) -> StereoRig:
    K = np.array([[721.5377 + 1 / 3, 0, 609.5593], [0, 721.1 + 1 / 7, 172.854], [0, 0, 1.0]])
    K_right = K + np.array([[0.0, 0, doffs_px], [0, 0, 0], [0, 0, 0]])
    t_m = np.array([-0.193001, 0.0, 0.0])
    return StereoRig(
        Camera(K, 1242, 375, frame="camera_left"),
        Camera(K_right, 1242, 375, frame="camera_right"),
        Pose.from_rotation("camera_right", "camera_left", np.eye(3), t_m),
    )


def assert_same_cameras(got: StereoRig, want: StereoRig) -> None:
    for mine, theirs in ((got.left, want.left), (got.right, want.right)):
        assert mine.K.tobytes() == theirs.K.tobytes()
        assert mine.size_px == theirs.size_px
        assert mine.distortion[np.nonzero(mine.distortion)].tobytes() == (
            theirs.distortion[np.nonzero(theirs.distortion)].tobytes()
        )
    assert np.array_equal(got.T_right_left.matrix, want.T_right_left.matrix)


# --- OpenCV ------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_what_opencv_wrote_is_read_to_the_last_bit(form: str, tmp_path: Path) -> None:
    values = stereo()
    path = by_opencv(tmp_path / f"stereo.{form}", values)
    reading = read_any_rig(path, size_px=SIZE, unit="mm")
    raw, rectified = reading.raw, reading.of_rectified
    assert raw is not None
    assert raw.left.K.tobytes() == values["M1"].astype(float).tobytes()
    assert raw.right.K.tobytes() == values["M2"].astype(float).tobytes()
    assert raw.right.distortion.tobytes() == LENS.tobytes()
    assert raw.T_right_left.matrix[:3, :3].tobytes() == values["R"].tobytes()
    assert raw.T_right_left.translation_m.tolist() == [-0.12, 0.001, 0.002]
    assert not raw.is_rectified
    assert rectified.is_rectified
    assert rectified.left.K.tobytes() == values["P1"][:, :3].tobytes()
    assert rectified.doffs_px == values["P2"][0, 2] - values["P1"][0, 2] != 0
    assert rectified.baseline_m == pytest.approx(-values["P2"][0, 3] / values["P2"][0, 0] / 1000)
    assert "taken for rectified" in reading.taken_for("auto").notes[-1]
    assert reading.taken_for("raw").of_pictures is raw
    assert not reading.taken_for("raw").notes


def test_the_q_of_opencv_gives_the_points_of_its_p(tmp_path: Path) -> None:
    values = stereo()
    path = by_opencv(tmp_path / "stereo.yml", values)
    got = read_any_rig(path, size_px=SIZE, unit="mm").of_rectified
    rng = np.random.default_rng(3)
    u, v, d = rng.uniform(100, 500, 50), rng.uniform(50, 400, 50), rng.uniform(5, 60, 50)
    theirs = (values["Q"] @ np.stack([u, v, d, np.ones(50)])).T
    wanted_m = theirs[:, :3] / theirs[:, 3:] / 1000
    np.testing.assert_allclose(points_by_p(d, u, v, got), wanted_m, rtol=1e-6)
    np.testing.assert_allclose(points_by_q(d, u, v, got), wanted_m, rtol=1e-6)


def test_a_q_of_another_rig_is_refused(tmp_path: Path) -> None:
    values = dict(stereo())
    values["Q"] = values["Q"].copy()
    values["Q"][2, 3] *= 1.001
    path = by_opencv(tmp_path / "stereo.yml", values)
    with pytest.raises(CalibrationValue, match="Q has f") as error:
        read_any_rig(path, size_px=SIZE, unit="mm")
    assert "Q, line" in error.value.where


def test_nested_maps_single_files_and_other_names(tmp_path: Path) -> None:
    values = stereo()
    storage = cv2.FileStorage(str(tmp_path / "nested.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    for eye, n in (("left", 1), ("right", 2)):
        storage.startWriteStruct(eye, cv2.FILE_NODE_MAP)
        storage.write("cameraMatrix", values[f"M{n}"])
        storage.write("distCoeffs", values[f"D{n}"])
        storage.endWriteStruct()
    storage.startWriteStruct("extrinsics", cv2.FILE_NODE_MAP | cv2.FILE_NODE_FLOW)
    storage.write("note", "by hand: #1")
    storage.endWriteStruct()
    storage.write("R", values["R"])
    storage.write("T", values["T"] / 1000)
    storage.release()
    raw = read_any_rig(tmp_path / "nested.yml").raw
    assert raw is not None
    assert raw.left.K.tobytes() == values["M1"].astype(float).tobytes()
    folder = tmp_path / "pair"
    folder.mkdir()
    by_opencv(folder / "left.yml", {"camera_matrix": values["M1"], "dist_coeff": values["D1"]})
    by_opencv(folder / "right.yml", {"camera_matrix": values["M2"], "dist_coeff": values["D2"]})
    by_opencv(folder / "extrinsics.yml", {"R": values["R"], "T": values["T"] / 1000})
    again = read_any_rig(folder, size_px=SIZE).raw
    assert again is not None
    assert_same_cameras(again, raw)


def test_an_unrectified_rig_is_read_and_refused_where_a_rectified_one_is_needed(
    tmp_path: Path,
) -> None:
    values = {name: stereo()[name] for name in ("M1", "D1", "M2", "D2", "R", "T")}
    reading = read_any_rig(by_opencv(tmp_path / "a.xml", values), size_px=SIZE, unit="mm")
    assert reading.raw is not None
    with pytest.raises(NotRectified, match="unrectified cameras"):
        _ = reading.of_rectified


def test_our_yaml_is_opencvs_and_ours(tmp_path: Path) -> None:
    for number, mine in enumerate((rig(), rig(doffs_px=2.5))):
        path = tmp_path / f"{number}.yml"
        write_opencv(path, mine)
        assert_same_cameras(read_any_rig(path).of_rectified, mine)
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        for name, want in (("M1", mine.left.K), ("P2", mine.P_right)):
            node = storage.getNode(name)
            assert node.mat().tobytes() == want.tobytes(), name
        storage.release()


# --- ROS ---------------------------------------------------------------------------------------

ROS = """image_width: 640
image_height: 480
camera_name: narrow_stereo/{eye}
camera_matrix:
  rows: 3
  cols: 3
  data: [500.25, 0, 320.5, 0, 501.5, 240.25, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.05, 0.001, 0.002, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [480.5, 0, 318.0, {tx}, 0, 480.5, 239.0, 0, 0, 0, 1, 0]
"""
LEFT, RIGHT = ROS.format(eye="left", tx="0"), ROS.format(eye="right", tx="-57.66")


def ros_files(folder: Path) -> list[Path]:
    """The pair in each form that `--rig` takes."""
    pair = folder / "pair"
    pair.mkdir()
    (pair / "left.yaml").write_text(LEFT)
    (pair / "right.yaml").write_text(RIGHT)
    one = folder / "one.yaml"
    one.write_text(f"---\n{LEFT}---\n{RIGHT}...\n")
    nested = folder / "nested.yaml"
    indented = ["left:", *LEFT.splitlines(), "right:", *RIGHT.splitlines()]
    nested.write_text(
        "\n".join(line if line in ("left:", "right:") else f"    {line}" for line in indented)
    )
    return [pair, pair / "left.yaml", Path(f"{pair}/left.yaml,{pair}/right.yaml"), one, nested]


def test_camera_info_in_every_arrangement(tmp_path: Path) -> None:
    for path in ros_files(tmp_path):
        reading = read_any_rig(path)
        got = reading.of_rectified
        assert reading.form == "ROS camera_info", path
        assert (got.left.focal_px, got.left.K[0, 2], got.left.size_px) == (480.5, 318.0, SIZE)
        assert got.baseline_m == pytest.approx(0.12, rel=1e-15), path
        assert reading.raw is not None
        assert reading.raw.left.K[0, 0] == 500.25
        assert len(reading.raw.left.distortion) == 5


def test_a_message_as_ros_prints_it(tmp_path: Path) -> None:
    text = (
        "header: \n  seq: 1\n  stamp: \n    secs: 1\n    nsecs: 2\n  frame_id: cam\n"
        "height: 480\nwidth: 640\ndistortion_model: plumb_bob\n"
        "D: [0.1, 0.0, 0.0, 0.0, 0.0]\nK: [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]\n"
        "R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
        "P: [480.5, 0.0, 318.0, {}, 0.0, 480.5, 239.0, 0.0, 0.0, 0.0, 1.0, 0.0]\n"
        "binning_x: 0\nroi: \n  x_offset: 0\n  do_rectify: False\n"
    )
    for eye, tx in (("left", "0.0"), ("right", "-57.66")):
        (tmp_path / f"{eye}_info.yaml").write_text(text.format(tx))
    assert read_any_rig(tmp_path).of_rectified.baseline_m == pytest.approx(0.12)


def test_our_camera_info_is_read_back(tmp_path: Path) -> None:
    mine = rig(doffs_px=2.5)
    write_camera_info(tmp_path / "left.yaml", tmp_path / "right.yaml", unchanged(mine))
    got = read_any_rig(tmp_path).of_rectified
    assert got.left.K.tobytes() == mine.left.K.tobytes()
    assert got.right.K.tobytes() == mine.right.K.tobytes()
    # The file has f B alone: the quotient may differ in its last bit.
    assert got.baseline_m == pytest.approx(mine.baseline_m, rel=3e-16)
    raw = StereoRig(
        mine.left, mine.right, Pose.from_rotation(
            "camera_right", "camera_left", cv2.Rodrigues(np.array([0, 0.1, 0]))[0],
            np.array([-0.1, 0, 0])
        )
    )  # fmt: skip
    with pytest.raises(NotRectified):
        write_camera_info(tmp_path / "left.yaml", tmp_path / "right.yaml", unchanged(raw))


# --- K.txt, Middlebury, KITTI, ours ------------------------------------------------------------

CALIB = (
    "cam0=[994.978 0 311.193; 0 994.978 254.877; 0 0 1]\n"
    "cam1=[994.978 0 342.279; 0 994.978 254.877; 0 0 1]\n"
    "doffs=31.086\nbaseline=193.001\nwidth=741\nheight=497\nndisp=70\nisint=0\n"
    "vmin=5\nvmax=61\ndyavg=0\ndymax=0\n"
)


def test_k_txt(tmp_path: Path) -> None:
    path = tmp_path / "K.txt"
    path.write_text("754.6 0.0 489.3 0.0 754.6 265.1 0.0 0.0 1.0\n0.063\n")
    got = read_any_rig(path, size_px=(960, 540)).of_rectified
    assert (got.left.focal_px, got.baseline_m, got.doffs_px) == (754.6, 0.063, 0.0)
    write_k_txt(path, rig())
    assert_same_cameras(read_any_rig(path, size_px=(1242, 375)).of_rectified, rig())
    with pytest.raises(StructureError, match="two different cameras"):
        write_k_txt(path, rig(doffs_px=1.0))
    with pytest.raises(CalibrationField, match="no image size"):
        read_any_rig(path)


def test_middlebury_doffs_is_applied_and_said(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(CALIB)
    reading = read_any_rig(path)
    got = reading.of_rectified
    assert got.baseline_m == 0.193001
    assert got.doffs_px == pytest.approx(31.086, abs=1e-9)
    assert "doffs 31.086 px applied" in reading.notes[0]
    # Z[mm] = baseline f / (d + doffs), as Middlebury says
    z_m = points_by_q(np.array([20.0]), np.array([300.0]), np.array([200.0]), got)[0, 2]
    assert z_m == pytest.approx(193.001 * 994.978 / (20 + 31.086) / 1000, rel=1e-12)
    for mine in (rig(), rig(doffs_px=2.5)):
        write_middlebury_calib(path, mine, ndisp=100)
        assert_same_cameras(read_middlebury_calib(path).of_rectified, mine)


@pytest.mark.parametrize(
    ("change", "kind", "text"),
    [
        (("doffs=31.086", "doffs=13.086"), CalibrationValue, "doffs 13.086 px, but cx of cam1"),
        (("ndisp=70", "ndisp=0"), CalibrationValue, "ndisp 0"),
        (("ndisp=70", "ndisp=7000"), CalibrationValue, "ndisp 7000"),
        (("baseline=193.001\n", ""), CalibrationField, "no baseline"),
        (("width=741\n", ""), CalibrationField, "no width"),
        (("cam1", "cam2"), CalibrationField, "no cam1"),
        (("ndisp=70", "doffs=31.086"), CalibrationField, "doffs twice, in lines 3 and 7"),
        (("baseline=193.001", "baseline=193,001"), CalibrationSyntax, "line 4, column 10"),
        (("[994.978 0 311", "[994.978 311"), CalibrationSyntax, "line 1: 8 numbers"),
    ],
)
def test_middlebury_mistakes_are_named(
    change: tuple[str, str], kind: type[PseudolidarError], text: str, tmp_path: Path
) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(CALIB.replace(*change, 1))
    with pytest.raises(kind) as error:
        read_any_rig(path)
    assert text in str(error.value)


def test_middlebury_without_doffs_or_ndisp_says_what_it_takes(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(CALIB.replace("doffs=31.086\n", "").replace("ndisp=70\n", ""))
    reading = read_any_rig(path)
    assert reading.of_rectified.doffs_px == pytest.approx(31.086, abs=1e-9)
    assert "no doffs; 31.086 px taken" in reading.notes[0]
    assert "no ndisp" in reading.notes[1]
    assert reading.min_depth_m is None


def test_rig_json_passes_through(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", rig(doffs_px=2.5))
    assert_same_cameras(read_any_rig(tmp_path / "rig.json").of_rectified, rig(doffs_px=2.5))
    assert_same_cameras(read_any_rig(tmp_path).of_rectified, rig(doffs_px=2.5))


@pytest.mark.real
def test_kitti_files(real_data: Path) -> None:
    raw = read_any_rig(real_data / "kitti_raw" / "2011_09_26").of_rectified
    assert raw.baseline_m == pytest.approx(0.53273, abs=1e-5)
    assert raw.T_left_velodyne is not None
    grey = real_data / "odd_formats" / "odometry_calib_without_labels.txt"
    assert read_any_rig(grey, size_px=(1241, 376)).of_rectified.baseline_m == pytest.approx(
        0.53715, abs=1e-5
    )


@pytest.mark.real
@pytest.mark.parametrize("name", ["", "opencv_extrinsics.yml", "opencv_intrinsics.yml"])
def test_the_real_rig_of_exchanged_eyes_is_named(name: str, real_data: Path) -> None:
    with pytest.raises(CalibrationValue, match="stands right of the other") as error:
        read_any_rig(real_data / "odd_formats" / name, size_px=(640, 512))
    assert str(error.value.path).endswith("opencv_extrinsics.yml")
    assert error.value.where == "P2, line 44, column 4"


# --- units -------------------------------------------------------------------------------------


def test_the_unit_is_asked_for_and_never_guessed(tmp_path: Path) -> None:
    path = by_opencv(tmp_path / "stereo.yml", stereo())
    with pytest.raises(CalibrationUnits, match="--rig-unit mm"):
        read_any_rig(path, size_px=SIZE)
    assert read_any_rig(path, size_px=SIZE, unit="mm").of_rectified.baseline_m < 0.121
    assert read_any_rig(path, size_px=SIZE, unit="cm").of_rectified.baseline_m > 1.2
    assert read_any_rig(path, size_px=SIZE, unit="m").of_rectified.baseline_m > 120
    k_txt = tmp_path / "K.txt"
    k_txt.write_text("754.6 0 489.3 0 754.6 265.1 0 0 1\n63\n")
    with pytest.raises(CalibrationUnits, match="--rig-unit mm"):
        read_any_rig(k_txt, size_px=(960, 540))
    assert read_any_rig(k_txt, size_px=(960, 540), unit="mm").of_rectified.baseline_m == 0.063


@pytest.mark.parametrize(("stated", "unit"), [("0.193001", "m"), ("193001", None)])
def test_millimetres_of_middlebury_that_cannot_be(
    stated: str, unit: Literal["m"] | None, tmp_path: Path
) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(CALIB.replace("baseline=193.001", f"baseline={stated}"))
    with pytest.raises(CalibrationUnits, match="baseline, line 4") as error:
        read_any_rig(path)
    assert "--rig-unit m" in error.value.fix
    if unit is not None:
        assert read_any_rig(path, unit=unit).of_rectified.baseline_m == 0.193001
