"""Rigs in the forms of other programs: what each form holds comes back, and others read it too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationUnits,
    NotRectified,
    StructureError,
    UsageError,
)
from pseudolidar.formats.rigs.kalibr import camchain_text
from pseudolidar.formats.rigs.kitti import write_raw_calib
from pseudolidar.formats.rigs.opencv_rig_writers import write_opencv
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_json import read_rig, write_rig
from pseudolidar.formats.rigs.rig_reading import RigReading
from pseudolidar.formats.rigs.rig_writers import RigForm, form_of, write_any_rig
from pseudolidar.geometry.rectification import rectification
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.pose import Pose
from tests.raw_rigs import raw_rig
from tests.recordings import small_rig

LENSES = [("pinhole", 4), ("pinhole", 5), ("pinhole", 8), ("pinhole", 12), ("fisheye", 4)]
SIZES = [(640, 480), (320, 240)]


def reading_of(rig: StereoRig) -> RigReading:
    return RigReading(Path("rig.json"), "rig.json", rig if rig.is_rectified else None, rig)


def assert_same_cameras(got: StereoRig | None, want: StereoRig, *, exact: bool = True) -> None:
    assert got is not None
    for mine, theirs in ((got.left, want.left), (got.right, want.right)):
        assert mine.K.tobytes() == theirs.K.tobytes()
        assert (mine.size_px, mine.model) == (theirs.size_px, theirs.model)
        np.testing.assert_array_equal(
            mine.distortion[: len(theirs.distortion)], theirs.distortion[: len(mine.distortion)]
        )
        assert not mine.distortion[len(theirs.distortion) :].any()
    if exact:
        np.testing.assert_array_equal(got.T_right_left.matrix, want.T_right_left.matrix)
    else:
        np.testing.assert_allclose(got.T_right_left.matrix, want.T_right_left.matrix, atol=1e-14)


@pytest.mark.parametrize("size_px", SIZES)
@pytest.mark.parametrize(("model", "count"), LENSES)
@pytest.mark.parametrize("name", ["a.yml", "a.yaml", "a.xml", "a.json", "ros", "l.yaml,r.yaml"])
def test_unrectified_rigs_of_every_lens_come_back(
    name: str, model: str, count: int, size_px: tuple[int, int], tmp_path: Path
) -> None:
    rig = raw_rig(count, model=model, right_px=size_px)  # type: ignore[arg-type]
    out = ",".join(str(tmp_path / part) for part in name.split(","))
    form = {"a.json": "opencv", "ros": "ros"}.get(name)
    written = write_any_rig(out, reading_of(rig), form=form)  # type: ignore[arg-type]
    assert all(file.exists() for file in written.files)
    got = read_any_rig(out)
    assert_same_cameras(got.raw, rig, exact=written.form == "opencv")
    if written.form == "opencv":
        # Nothing says that the pictures are rectified, and so nobody takes them for it.
        assert got.rectified is None
    else:
        plan = rectification(rig)
        assert any("is computed (alpha 0)" in note for note in written.notes)
        assert got.rectified is not None
        np.testing.assert_allclose(got.rectified.left.K, plan.rig.left.K)
        assert got.rectified.baseline_m == pytest.approx(plan.rig.baseline_m, rel=1e-15)


@pytest.mark.parametrize("name", ["a.yml", "a.json", "ros"])
@pytest.mark.parametrize("models", [("pinhole", "fisheye"), ("fisheye", "pinhole")])
def test_eyes_with_lenses_of_two_kinds_come_back(
    models: tuple[str, str], name: str, tmp_path: Path
) -> None:
    left, right = (raw_rig(4, model=model) for model in models)  # type: ignore[arg-type]
    rig = replace(left, right=right.right)
    out = str(tmp_path / name)
    write_any_rig(out, reading_of(rig), form="ros" if name == "ros" else "opencv")
    got = read_any_rig(out).raw
    assert (got.left.model, got.right.model) == models
    assert_same_cameras(got, rig, exact=name != "ros")


def test_q_is_left_out_where_pixels_are_not_square(tmp_path: Path) -> None:
    """OpenCV's Q knows one focal length; P1 and P2 know both."""
    square = small_rig()
    K = square.left.K * [[1, 1, 1], [1, 1.1, 1], [1, 1, 1]]
    flat = replace(square, left=replace(square.left, K=K), right=replace(square.right, K=K))
    for rig, has_q in ((square, True), (flat, False)):
        path = tmp_path / f"{has_q}.yml"
        write_any_rig(str(path), reading_of(rig))
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        Q, P2 = storage.getNode("Q"), storage.getNode("P2").mat()
        assert (not Q.empty()) == has_q
        np.testing.assert_array_equal(P2, rig.P_right)
        if has_q:
            np.testing.assert_array_equal(Q.mat(), rig.Q)
        assert_same_cameras(read_any_rig(path).of_rectified, rig)


@pytest.mark.parametrize("name", ["a.yml", "a.xml", "a.json"])
@pytest.mark.parametrize(("model", "count"), LENSES)
def test_opencv_reads_every_number(name: str, model: str, count: int, tmp_path: Path) -> None:
    rig = raw_rig(count, model=model)  # type: ignore[arg-type]
    write_any_rig(str(tmp_path / name), reading_of(rig), form="opencv")
    storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
    wanted = {"M1": rig.left.K, "D1": rig.left.distortion, "M2": rig.right.K,
              "D2": rig.right.distortion, "R": rig.T_right_left.matrix[:3, :3],
              "T": rig.T_right_left.translation_m}  # fmt: skip
    for key, value in wanted.items():
        node = storage.getNode(key)
        assert node.mat().ravel().tobytes() == value.ravel().tobytes(), key
    assert storage.getNode("image_width").real() == 640
    storage.release()


def test_opencv_rectifies_with_our_file_as_we_do(tmp_path: Path) -> None:
    """What a user's own script makes of the file: stereoRectify gives P1 and P2 of our ROS file."""
    rig = raw_rig(5)
    write_any_rig(str(tmp_path / "a.yml"), reading_of(rig))
    storage = cv2.FileStorage(str(tmp_path / "a.yml"), cv2.FILE_STORAGE_READ)
    nodes = {key: storage.getNode(key) for key in ("M1", "D1", "M2", "D2", "R", "T")}
    M1, D1, M2, D2, R, T = (node.mat() for node in nodes.values())
    storage.release()
    R1, R2, *_ = cv2.stereoRectify(M1, D1, M2, D2, (640, 480), R, T, alpha=0)
    write_any_rig(str(tmp_path / "ros"), reading_of(rig), form="ros")
    turns = read_any_rig(tmp_path / "ros").turns
    assert turns is not None
    np.testing.assert_allclose(turns[0], R1, atol=1e-12)
    np.testing.assert_allclose(turns[1], R2, atol=1e-12)


@pytest.mark.parametrize("doffs_px", [0.0, 2.5])
@pytest.mark.parametrize("name", ["a.yml", "a.xml", "ros", "a/calib.txt", "a/000001.txt", "raw"])
def test_rectified_rigs_come_back(name: str, doffs_px: float, tmp_path: Path) -> None:
    rig = small_rig()
    shifted = rig.right.K + np.array([[0, 0, doffs_px], [0, 0, 0], [0, 0, 0]])
    rig = replace(rig, right=replace(rig.right, K=shifted), correction=None)
    form = {"ros": "ros", "raw": "kitti-raw"}.get(name)
    (tmp_path / "a").mkdir()
    out = str(tmp_path / name)
    written = write_any_rig(out, reading_of(rig), form=form)  # type: ignore[arg-type]
    got = read_any_rig(out, size_px=rig.left.size_px).of_rectified
    assert_same_cameras(got, rig, exact=False)
    if written.form in ("kitti-raw", "kitti-odometry", "kitti-object"):
        assert got.T_left_velodyne is not None
        assert rig.T_left_velodyne is not None
        np.testing.assert_allclose(
            got.T_left_velodyne.matrix, rig.T_left_velodyne.matrix, atol=1e-12
        )


def test_a_file_that_has_both_keeps_its_own_rectification(tmp_path: Path) -> None:
    """OpenCV to ROS and back: R1, R2, P1 and P2 of the first file, not computed anew."""
    rig = raw_rig(8)
    K1, D1, K2, D2 = rig.left.K, rig.left.distortion, rig.right.K, rig.right.distortion
    T = rig.T_right_left.matrix
    R1, R2, P1, P2, Q = cv2.stereoRectify(
        K1, D1, K2, D2, (640, 480), T[:3, :3], T[:3, 3:], alpha=1
    )[:5]
    storage = cv2.FileStorage(str(tmp_path / "a.yml"), cv2.FILE_STORAGE_WRITE)
    values = {"M1": K1, "D1": D1, "M2": K2, "D2": D2, "R": T[:3, :3], "T": T[:3, 3:],
              "R1": R1, "R2": R2, "P1": P1, "P2": P2, "Q": Q}  # fmt: skip
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    first = read_any_rig(tmp_path / "a.yml", size_px=(640, 480))
    assert list(first.projections) == ["P1", "P2"]
    write_any_rig(str(tmp_path / "ros"), first, form="ros")
    second = read_any_rig(tmp_path / "ros")
    write_any_rig(str(tmp_path / "b.yml"), second)
    third = read_any_rig(tmp_path / "b.yml")
    for got in (second, third):
        assert got.turns is not None
        np.testing.assert_array_equal(got.turns[0], R1)
        np.testing.assert_array_equal(got.turns[1], R2)
        np.testing.assert_array_equal(got.projections["P1"], P1)
        np.testing.assert_allclose(got.projections["P2"], P2, rtol=1e-14)
        assert_same_cameras(got.raw, rig, exact=False)


# --- ROS, as its tools read it -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "count", "named"),
    [
        ("pinhole", 5, "plumb_bob"),
        ("pinhole", 8, "rational_polynomial"),
        ("fisheye", 4, "equidistant"),
    ],
)
def test_yaml_of_ros_is_what_camera_info_manager_reads(
    model: str, count: int, named: str, tmp_path: Path
) -> None:
    yaml = pytest.importorskip("yaml")
    rig = raw_rig(count, model=model)  # type: ignore[arg-type]
    write_any_rig(str(tmp_path), reading_of(rig), form="ros")
    for eye, camera in (("left", rig.left), ("right", rig.right)):
        info = yaml.safe_load((tmp_path / f"{eye}.yaml").read_text())
        assert list(info) == ["image_width", "image_height", "camera_name", "distortion_model",
                              "camera_matrix", "distortion_coefficients", "rectification_matrix",
                              "projection_matrix"]  # fmt: skip
        assert info["distortion_model"] == named
        for key, shape in (("camera_matrix", (3, 3)), ("rectification_matrix", (3, 3)),
                           ("projection_matrix", (3, 4))):  # fmt: skip
            assert (info[key]["rows"], info[key]["cols"]) == shape
            assert len(info[key]["data"]) == shape[0] * shape[1]
        assert info["camera_matrix"]["data"] == camera.K.ravel().tolist()
        assert info["distortion_coefficients"]["data"] == camera.distortion.tolist()
    # Tx of the right camera, as image_geometry and stereo_image_proc take it: -fx B.
    P = np.array(info["projection_matrix"]["data"]).reshape(3, 4)
    assert -P[0, 3] / P[0, 0] == pytest.approx(rectification(rig).rig.baseline_m)


def test_a_lens_that_a_form_cannot_say_is_refused(tmp_path: Path) -> None:
    for count in (5, 8):
        with pytest.raises(StructureError, match="Kalibr's radtan"):
            camchain_text(raw_rig(count))
    with pytest.raises(StructureError, match="k1 k2 p1 p2 k3"):
        write_any_rig(str(tmp_path), reading_of(raw_rig(8)), form="kitti-raw")
    with pytest.raises(NotRectified, match="distortion of pinhole lenses; fx 500 px left and 505"):
        write_any_rig(str(tmp_path / "calib.txt"), reading_of(raw_rig(5)))
    with pytest.raises(NotRectified):
        write_raw_calib(tmp_path, raw_rig(5))
    assert not list(tmp_path.iterdir())


# --- KITTI, as its devkit reads it ---------------------------------------------------------------


def test_unrectified_cameras_in_the_layout_of_kitti_raw(tmp_path: Path) -> None:
    """Read as KITTI's `loadCalibrationCamToCam.m` does: names, order, formulas of the devkit."""
    rig = raw_rig(5)
    write_any_rig(str(tmp_path), reading_of(rig), form="kitti-raw")
    fields = {}
    for line in (tmp_path / "calib_cam_to_cam.txt").read_text().splitlines():
        key, numbers = line.split(":", 1)
        fields[key] = np.array([float(word) for word in numbers.split()])
    names = ("S", "K", "D", "R", "T", "S_rect", "R_rect", "P_rect")
    assert list(fields) == [f"{name}_0{n}" for n in range(4) for name in names]
    point = np.array([0.4, -0.1, 3.0])  # in camera 0 as mounted
    seen = []
    for n, camera in ((0, rig.left), (1, rig.right)):
        R, T = fields[f"R_0{n}"].reshape(3, 3), fields[f"T_0{n}"]
        K, D = fields[f"K_0{n}"].reshape(3, 3), fields[f"D_0{n}"]
        at = R @ point + T
        raw_px = cv2.projectPoints(at[None], np.zeros(3), np.zeros(3), K, D)[0].ravel()
        # What rectifying the picture does to this pixel, by OpenCV.
        R_rect, P_rect = (fields[f"{name}_0{n}"] for name in ("R_rect", "P_rect"))
        flat = cv2.undistortPoints(raw_px[None, None], K, D, R=R_rect.reshape(3, 3),
                                   P=P_rect.reshape(3, 4)[:, :3])  # fmt: skip
        # And the devkit's chain: P_rect R_rect_00 x_cam0.
        x = P_rect.reshape(3, 4) @ [*(fields["R_rect_00"].reshape(3, 3) @ point), 1]
        np.testing.assert_allclose(flat.ravel(), x[:2] / x[2], atol=2e-3)
        seen.append(x[:2] / x[2])
        assert fields[f"S_0{n}"].tolist() == [*camera.size_px]
    assert seen[0][1] == pytest.approx(seen[1][1], abs=1e-9)
    assert read_any_rig(tmp_path).of_rectified.baseline_m == pytest.approx(
        rectification(rig).rig.baseline_m
    )


# --- names, and what is lost ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "form"),
    [("rig.json", "rig"), ("x/stereo.yaml", "opencv"), ("a.XML", "opencv"), ("K.txt", "k-txt"),
     ("my-camchain.yaml", "kalibr"), ("l.yaml,r.yaml", "ros"), ("calib.txt", "kitti-odometry"),
     ("000012.txt", "kitti-object"), ("d/calib_cam_to_cam.txt", "kitti-raw")],
)  # fmt: skip
def test_the_form_follows_from_the_name(name: str, form: str) -> None:
    assert form_of(name) == form


@pytest.mark.parametrize("name", ["out", "a.txt", "stereo.toml"])
def test_a_name_without_a_form_asks_for_it(name: str) -> None:
    with pytest.raises(UsageError, match="--to"):
        form_of(name)


def test_what_a_form_does_not_hold_is_said(tmp_path: Path) -> None:
    from tests.formats.rigs.test_rig_json import full_rig
    from tests.formats.rigs.test_rig_quality import known_quality

    rig = replace(full_rig(rectified=True), quality=known_quality())
    rig = replace(rig, right=replace(rig.right, K=rig.left.K))
    (note,) = write_any_rig(str(tmp_path / "a.yml"), reading_of(rig)).notes
    for words in ("disparity correction", "row correction", "quality", "Velodyne", "IMU"):
        assert words in note
    assert write_any_rig(str(tmp_path / "rig.json"), reading_of(rig)).notes == ()
    assert read_rig(tmp_path / "rig.json").quality is not None
    (note,) = write_any_rig(str(tmp_path / "calib.txt"), reading_of(rig)).notes
    assert "sizes" in note
    assert "Velodyne" not in note


@pytest.mark.parametrize("form", [form for form in get_args(RigForm) if form != "rig"])
def test_lengths_that_are_no_metres_do_not_become_some(form: RigForm, tmp_path: Path) -> None:
    unknown = replace(small_rig(), metric=False)
    with pytest.raises(CalibrationUnits, match="unknown scale"):
        write_any_rig(str(tmp_path / "out"), reading_of(unknown), form=form)
    assert not (tmp_path / "out").exists()
    written = write_any_rig(str(tmp_path / "rig.json"), reading_of(unknown))
    assert not read_rig(written.files[0]).metric


def test_of_both_rigs_the_rectified_one_goes_into_rig_json(tmp_path: Path) -> None:
    write_any_rig(str(tmp_path / "ros"), reading_of(raw_rig(5)), form="ros")
    written = write_any_rig(str(tmp_path / "rig.json"), read_any_rig(tmp_path / "ros"))
    assert any("not those as taken" in note for note in written.notes)
    assert read_rig(tmp_path / "rig.json").is_rectified


def test_two_files_are_for_ros_alone(tmp_path: Path) -> None:
    rig = reading_of(small_rig())
    for out, form in ((f"{tmp_path}/a.yml,{tmp_path}/b.yml", "opencv"),
                      (f"{tmp_path}/a,{tmp_path}/b,{tmp_path}/c", "ros"),
                      (f"{tmp_path}/a.yaml,{tmp_path}/a.yaml", "ros")):  # fmt: skip
        with pytest.raises(UsageError, match="files for"):
            write_any_rig(out, rig, form=form)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_eyes_of_two_sizes_in_files_of_their_own(tmp_path: Path) -> None:
    """camera_info says a size for each eye, and both count."""
    rig = raw_rig(5, right_px=(320, 240))
    write_any_rig(str(tmp_path), reading_of(rig), form="ros")
    got = read_any_rig(tmp_path).raw
    assert got is not None
    assert (got.left.size_px, got.right.size_px) == ((640, 480), (320, 240))


def test_a_written_file_replaces_whole_files_only(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    write_rig(path, small_rig())
    before = path.read_bytes()
    with pytest.raises(StructureError):
        write_any_rig(str(path), reading_of(raw_rig(8)))
    assert path.read_bytes() == before


def test_a_rectified_rig_off_its_rows_keeps_its_digits(tmp_path: Path) -> None:
    """The right eye a little ahead, as KITTI's: Q is of the same rig, and T is not that of P."""
    rig = small_rig()
    place_m = np.array([-0.1 / 3, 0.0, 0.0004 / 3])
    pose = Pose.from_rotation("camera_right", "camera_left", np.eye(3), place_m)
    K = rig.left.K + np.array([[1 / 3, 0, 1 / 7], [0, 1 / 3, 0], [0, 0, 0]])
    K[1, 1] = K[0, 0]
    eyes = {"left": replace(rig.left, K=K), "right": replace(rig.right, K=K)}
    off = replace(rig, **eyes, T_right_left=pose)
    write_opencv(tmp_path / "a.yml", off)
    assert "Q: " in (tmp_path / "a.yml").read_text()
    got = read_any_rig(tmp_path / "a.yml").of_rectified
    assert got.T_right_left.matrix.tobytes() == pose.matrix.tobytes()


def test_a_camera_in_both_of_two_files_is_not_chosen_between(tmp_path: Path) -> None:
    write_opencv(tmp_path / "intrinsics.yml", small_rig())
    write_opencv(tmp_path / "extrinsics.yml", small_rig())
    with pytest.raises(CalibrationField, match="twice, the first time at"):
        read_any_rig(tmp_path)
