"""Calibrations as public data sets and programs lay them out: read right, or refused by name.

The layouts are theirs, the numbers are made up.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pseudolidar.errors import CalibrationField, CalibrationSyntax, CalibrationValue
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.geometry.twists import exp_twist
from pseudolidar.structures.camera import StereoRig

# A right camera 0.11 m to the right, a little below, and turned.
T_RIGHT_LEFT = exp_twist(np.array([-0.11, -0.002, 0.001, 0.01, -0.02, 0.03]))
# The left camera on the body, which lies on its side as in EuRoC.
T_BODY_LEFT = exp_twist(np.array([0.02, -0.06, 0.01, 0.0, 0.02, 1.5]))
INTRINSICS = ([458.5, 457.5, 367.5, 248.5], [457.25, 456.25, 379.5, 255.5])
LENSES = ([-0.28, 0.07, 0.0002, 1.5e-05], [-0.27, 0.06, -0.0001, -3.5e-05])


def rows(T: np.ndarray, indent: str) -> str:
    return "\n".join(f"{indent}- {row}" for row in T.tolist())


def kalibr_camera(number: int, *, lens: str, by: dict[str, np.ndarray]) -> str:
    lines = [f"cam{number}:"]
    for key, T in by.items():
        lines += [f"  {key}:", rows(T, "  ")]
    lines += [
        f"  cam_overlaps: [{1 - number}]",
        "  camera_model: pinhole",
        f"  distortion_coeffs: {LENSES[number]}",
        f"  distortion_model: {lens}",
        f"  intrinsics: {INTRINSICS[number]}",
        "  resolution: [752, 480]",
        f"  rostopic: /cam{number}/image_raw",
        "  timeshift_cam_imu: 0.00012",
    ]
    return "\n".join(lines) + "\n"


def sensor(number: int, T_body_camera: np.ndarray) -> str:
    data = ",\n         ".join(", ".join(map(repr, row)) for row in T_body_camera.tolist())
    return f"""\
# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam{number}

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [{data}]

# Camera specific definitions.
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: {INTRINSICS[number]} #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: {LENSES[number]}
"""


def assert_rig(rig: StereoRig | None, *, model: str = "pinhole") -> None:
    assert rig is not None
    np.testing.assert_allclose(rig.T_right_left.matrix, T_RIGHT_LEFT, atol=1e-12)
    for camera, (fx, fy, cx, cy), lens in zip(
        (rig.left, rig.right), INTRINSICS, LENSES, strict=True
    ):
        assert camera.K.tolist() == [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
        assert camera.distortion.tolist() == lens
        assert camera.model == model
        assert camera.size_px == (752, 480)


@pytest.mark.parametrize("lens", ["radtan", "equidistant"])
@pytest.mark.parametrize("by", ["both", "imu", "previous"])
def test_camchains_with_an_imu(lens: str, by: str, tmp_path: Path) -> None:
    T_left_imu = np.linalg.inv(T_BODY_LEFT)
    imu = ({"T_cam_imu": T_left_imu}, {"T_cam_imu": T_RIGHT_LEFT @ T_left_imu})
    chain = ({}, {"T_cn_cnm1": T_RIGHT_LEFT})
    told = {"both": [imu[n] | chain[n] for n in (0, 1)], "imu": imu, "previous": chain}[by]
    path = tmp_path / "camchain-imucam.yaml"
    path.write_text("".join(kalibr_camera(n, lens=lens, by=told[n]) for n in (0, 1)))
    model = "pinhole" if lens == "radtan" else "fisheye"
    reading = read_any_rig(path)
    assert_rig(reading.raw, model=model)
    assert reading.form == "Kalibr camchain"
    assert any("T_cam_imu" in note for note in reading.notes) == (by != "previous")


def test_a_camchain_where_one_camera_alone_has_an_imu(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    first = kalibr_camera(0, lens="radtan", by={"T_cam_imu": np.eye(4)})
    path.write_text(first + kalibr_camera(1, lens="radtan", by={}))
    with pytest.raises(CalibrationField, match="cam1 has no T_cn_cnm1"):
        read_any_rig(path)


@pytest.fixture
def euroc(tmp_path: Path) -> Path:
    """`mav0` with the files of both cameras."""
    for number, T in enumerate((T_BODY_LEFT, T_BODY_LEFT @ np.linalg.inv(T_RIGHT_LEFT))):
        (tmp_path / "mav0" / f"cam{number}").mkdir(parents=True)
        (tmp_path / "mav0" / f"cam{number}" / "sensor.yaml").write_text(sensor(number, T))
    return tmp_path / "mav0"


def test_euroc_by_its_folder_and_by_its_files(euroc: Path) -> None:
    for given in (euroc, f"{euroc}/cam0/sensor.yaml,{euroc}/cam1/sensor.yaml"):
        reading = read_any_rig(given)
        assert_rig(reading.raw)
        assert reading.form == "EuRoC sensor.yaml"
        assert "cam0 is the left camera, cam1 the right one" in reading.notes[0]


@pytest.mark.parametrize(
    ("old", "new", "where", "got"),
    [
        ("T_BS", "T_XY", "line 2", "cam1 has no T_BS; found sensor_type"),
        ("intrinsics", "intrinsic", "line 2", "cam1 has no intrinsics; found sensor_type"),
        ("radial-tangential", "fov", "distortion_model, line 19", "distortion 'fov'"),
        ("pinhole", "omni", "camera_model, line 17", "camera_model 'omni'"),
        ("457.25", "-457.25", "intrinsics, line 18", "focal lengths -457.25"),
        ("[752, 480]", "[752]", "resolution, line 16", "no picture size"),
        ("0.0, 0.0, 0.0, 1.0]", "0.0, 0.0, 0.0, 2.0]", "T_BS, line 7", "T_BS with last row"),
    ],
)
def test_mistakes_in_a_sensor_file(euroc: Path, old: str, new: str, where: str, got: str) -> None:
    path = euroc / "cam1" / "sensor.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises((CalibrationField, CalibrationSyntax, CalibrationValue)) as caught:
        read_any_rig(euroc)
    assert caught.value.path == str(path)
    assert caught.value.where.startswith(where)
    assert got in caught.value.got


def test_exchanged_sensor_files_are_named(euroc: Path) -> None:
    with pytest.raises(CalibrationValue, match="stands right of the other") as caught:
        read_any_rig(f"{euroc}/cam1/sensor.yaml,{euroc}/cam0/sensor.yaml")
    assert caught.value.where.startswith("T_BS, line 7")


# --- matrices by other names ---------------------------------------------------------------------

K = [[500.5, 0.0, 320.0], [0.0, 501.5, 240.0], [0.0, 0.0, 1.0]]
D = [-0.1, 0.05, 0.001, -0.002, 0.01]
R, T = T_RIGHT_LEFT[:3, :3].tolist(), T_RIGHT_LEFT[:3, 3].tolist()


@pytest.mark.parametrize(
    "fields",
    [
        {"K1": K, "D1": [D], "K2": K, "D2": [D], "R": R, "T": [[x] for x in T]},
        {"left": {"K": K, "dist": D}, "right": {"K": K, "dist": D}, "R": R, "T": T},
        {"camera_matrix_1": K, "dist_1": D, "camera_matrix_2": K, "dist_2": D, "R": R, "T": T},
        {"cameraMatrix1": K, "distCoeffs1": D, "cameraMatrix2": K, "distCoeffs2": D, "R": R,
         "T": T},
        {"mtx_left": K, "dist_left": D, "mtx_right": K, "dist_right": D, "rotation": R,
         "translation": T},
    ],
    ids=["K1", "left.K", "camera_matrix_1", "cameraMatrix1", "mtx_left"],
)  # fmt: skip
def test_matrices_that_scripts_write_as_json(fields: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(fields | {"image_size": [640, 480]}))
    raw = read_any_rig(path).raw
    assert raw is not None
    assert raw.left.K.tolist() == raw.right.K.tolist() == K
    assert raw.left.distortion.tolist() == raw.right.distortion.tolist() == D
    np.testing.assert_allclose(raw.T_right_left.matrix, T_RIGHT_LEFT, atol=1e-15)
    assert raw.left.size_px == (640, 480)


def opencv(rows: int, cols: int, data: list[float]) -> str:
    return f"!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: {data}\n"


def test_settings_of_orb_slam(tmp_path: Path) -> None:
    """LEFT.K and the like are of the pictures as taken, P of the rectified ones."""
    half = exp_twist(np.array([0, 0, 0, 0.004, -0.006, 0.002]))[:3, :3]
    text = "%YAML:1.0\n\n#----------\n# Camera Parameters. Adjust them!\n#----------\n\n"
    text += "Camera.fx: 435.25\nCamera.bf: 47.875\nCamera.RGB: 1\nThDepth: 35\n"
    for eye, turn, offset in (("LEFT", half, 0.0), ("RIGHT", half.T, -47.875)):
        P = [435.25, 0.0, 367.5, offset, 0.0, 435.25, 252.25, 0.0, 0.0, 0.0, 1.0, 0.0]
        text += f"{eye}.height: 480\n{eye}.width: 752\n{eye}.D: {opencv(1, 5, D)}"
        text += f"{eye}.K: {opencv(3, 3, [*np.ravel(K).tolist()])}"
        text += f"{eye}.R:  {opencv(3, 3, [*np.ravel(turn).tolist()])}"
        text += f"{eye}.P:  {opencv(3, 4, P)}"
    (tmp_path / "orb.yaml").write_text(text + "ORBextractor.nFeatures: 1200\n")
    reading = read_any_rig(tmp_path / "orb.yaml")
    assert reading.rectified is not None
    assert reading.raw is not None
    assert reading.rectified.baseline_m == pytest.approx(47.875 / 435.25)
    assert reading.raw.left.size_px == (752, 480)
    # x_right = R2^T (R1 x_left + t)
    want = half @ half
    np.testing.assert_allclose(reading.raw.T_right_left.matrix[:3, :3], want, atol=1e-14)


def test_kitti_360_has_perspective_cameras_alone(tmp_path: Path) -> None:
    text = "calib_time: Mon, 06 Jan 2026 15:48:51 GMT\ncorner_dist: 0.1\n"
    for n, offset in ((0, "0.0"), (1, "-328.25")):
        text += f"S_0{n}: 1392.0 512.0\nK_0{n}: 788.5 0 687.25 0 786.5 317.75 0 0 1\n"
        text += f"D_0{n}: -0.34 0.15 -0.0008 0.0007 -0.03\nR_rect_0{n}: 1 0 0 0 1 0 0 0 1\n"
        text += f"S_rect_0{n}: 1408.0 376.0\n"
        text += f"P_rect_0{n}: 552.5 0 682.0 {offset} 0 552.5 238.75 0 0 0 1 0\n"
    (tmp_path / "perspective.txt").write_text(text)
    rig = read_any_rig(tmp_path / "perspective.txt").of_rectified
    assert rig.left.size_px == (1408, 376)
    assert rig.baseline_m == pytest.approx(328.25 / 552.5)


@pytest.mark.parametrize(
    ("name", "text", "got"),
    [
        ("zed.conf", "[LEFT_CAM_HD]\nfx=699.1\ncx=661.4\n\n[STEREO]\nBaseline=119.9\n",
         "a file that begins with '[LEFT_CAM_HD]'"),
        ("calib.npz", "PK\x03\x04abc", "a file that begins with 'PK"),
        ("head.yaml", "image_width: 640\nimage_height: 480\ncamera_matrix: [500, 0, 320, 0, 500, "
         "240, 0, 0, 1]\n", "no cameras of a pair, camera_matrix is of one"),
        ("vins.yaml", "%YAML:1.0\n---\nmodel_type: PINHOLE\nprojection_parameters:\n   fx: 461.5\n",
         "no cameras of a pair; found model_type, projection_parameters.fx"),
        ("orb3.yaml", "%YAML:1.0\nCamera1.fx: 458.5\nCamera2.fx: 457.5\nStereo.b: 0.11\n",
         "no cameras of a pair; found Camera1.fx, Camera2.fx, Stereo.b"),
    ],
    ids=["ini", "archive", "single", "vins", "orb3"],
)  # fmt: skip
def test_what_is_not_read_is_refused_by_what_it_is(
    name: str, text: str, got: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises((CalibrationField, CalibrationSyntax)) as caught:
        read_any_rig(tmp_path / name, size_px=(640, 480))
    assert caught.value.got.startswith(got)
    assert caught.value.want
    assert caught.value.where
