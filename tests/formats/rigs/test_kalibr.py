"""Camchains of Kalibr: read, written so that others read them, mistakes named by their place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.errors import (
    CalibrationField,
    CalibrationSyntax,
    CalibrationUnits,
    CalibrationValue,
    PseudolidarError,
    StructureError,
)
from pseudolidar.formats.rigs.kalibr import camchain_text, read_chain, write_camchain
from pseudolidar.formats.rigs.rig_file import read_any_rig
from tests.formats.rigs.test_rig_writers import assert_same_cameras
from tests.raw_rigs import raw_rig

CAMCHAIN = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99999751, 0.00231714, -0.00034393, -0.11007381]
  - [-0.00231207, 0.99989848, 0.01408984, 0.00039912]
  - [0.00037654, -0.01408901, 0.99990067, -0.00085370]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.28368365,  0.07451284, -0.00010473, -3.55590700e-05]
  distortion_model: radtan
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""


def camchain(path: Path, *changes: tuple[str, str]) -> Path:
    text = CAMCHAIN
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text)
    return path


def test_a_camchain_of_two_cameras(tmp_path: Path) -> None:
    reading = read_any_rig(camchain(tmp_path / "camchain.yaml"))
    assert reading.form == "Kalibr camchain"
    assert reading.rectified is None
    rig = reading.raw
    assert rig is not None
    assert rig.left.K[0, 0] == 458.654
    assert rig.right.K[1, 2] == 255.238
    assert rig.right.size_px == (752, 480)
    assert rig.left.model == "pinhole"
    assert rig.left.distortion.tolist() == [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
    assert rig.T_right_left.matrix[0, 3] == -0.11007381
    # found by its name in a folder of pictures as well
    assert read_any_rig(tmp_path).form == "Kalibr camchain"


@pytest.mark.parametrize(
    ("word", "model", "count"),
    [("equi", "fisheye", 4), ("equidistant", "fisheye", 4), ("none", "pinhole", 0)],
)
def test_lens_models_by_kalibrs_names(word: str, model: str, count: int, tmp_path: Path) -> None:
    change = ("distortion_model: radtan", f"distortion_model: {word}")
    raw = read_any_rig(camchain(tmp_path / "camchain.yaml", change)).raw
    assert raw.left.model == model
    assert len(raw.left.distortion) == count
    assert raw.right.model == "pinhole"
    assert len(raw.right.distortion) == 4


@pytest.mark.parametrize(("model", "count"), [("pinhole", 4), ("pinhole", 0), ("fisheye", 4)])
def test_a_camchain_comes_back_and_others_read_it(model: str, count: int, tmp_path: Path) -> None:
    yaml = pytest.importorskip("yaml")
    rig = raw_rig(count, model=model, right_px=(320, 240))  # type: ignore[arg-type]
    path = tmp_path / "camchain.yaml"
    write_camchain(path, rig)
    assert_same_cameras(read_any_rig(path).raw, rig)
    chain = yaml.safe_load(path.read_text())
    T = np.array(chain["cam1"]["T_cn_cnm1"])
    np.testing.assert_array_equal(T, rig.T_right_left.matrix)
    # A point of the world, projected by Kalibr's formulas, is seen where we see it.
    point = np.array([0.3, -0.2, 2.0])
    for name, camera, at in (("cam0", rig.left, point), ("cam1", rig.right, (T @ [*point, 1])[:3])):
        cam = chain[name]
        assert cam["camera_model"] == "pinhole"
        assert cam["distortion_model"] == ("radtan" if model == "pinhole" else "equidistant")
        assert cam["resolution"] == [camera.width_px, camera.height_px]
        fu, fv, pu, pv = cam["intrinsics"]
        x, y = kalibr_distorted(at[:2] / at[2], cam["distortion_model"], cam["distortion_coeffs"])
        K, D = camera.K, camera.distortion if len(camera.distortion) else np.zeros(4)
        project = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
        ours = project(at[None, None], np.zeros(3), np.zeros(3), K, D)[0].ravel()
        np.testing.assert_allclose([fu * x + pu, fv * y + pv], ours, rtol=1e-12)


def kalibr_distorted(xy: np.ndarray, model: str, k: list[float]) -> tuple[float, float]:
    """The formulas of Kalibr's aslam_cameras: RadialTangential and Equidistant distortion."""
    x, y = xy
    r2 = x * x + y * y
    if model == "radtan":
        radial = k[0] * r2 + k[1] * r2 * r2
        return (x + x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
                y + y * radial + 2 * k[3] * x * y + k[2] * (r2 + 2 * y * y))  # fmt: skip
    r = np.sqrt(r2)
    a = np.arctan(r)
    bent = a * (1 + k[0] * a**2 + k[1] * a**4 + k[2] * a**6 + k[3] * a**8)
    return x * bent / r, y * bent / r


def test_more_cameras_and_an_imu_are_said(tmp_path: Path) -> None:
    third = CAMCHAIN[CAMCHAIN.index("cam1:") :].replace("cam1:", "cam2:")
    path = tmp_path / "a.yaml"
    path.write_text(CAMCHAIN.replace("cam0:\n", "cam0:\n  T_cam_imu: [[1, 0, 0, 0]]\n") + third)
    notes = read_any_rig(path).notes
    assert any("cam2 left aside" in note for note in notes)
    assert any("T_cam_imu left aside" in note for note in notes)
    assert [camera.name for camera in read_chain(path)] == ["cam0", "cam1", "cam2"]


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (("camera_model: pinhole", "camera_model: omni"), CalibrationValue,
         "cam0.camera_model, line 3, column 17: camera_model 'omni'; wanted camera_model pinhole"),
        (("distortion_model: radtan", "distortion_model: fov"), CalibrationValue, "'fov'"),
        (("  intrinsics: [458.654, 457.296, 367.215, 248.375]\n", ""), CalibrationField,
         "cam0 has no intrinsics; found cam_overlaps"),
        (("457.296, 367.215", "367.215"), CalibrationSyntax, "3 numbers; wanted 4"),
        (("  resolution: [752, 480]\n", ""), CalibrationField, "cam0 has no resolution"),
        (("[752, 480]", "[752.5, 480]"), CalibrationSyntax, "cam0.resolution, line 7"),
        (("[752, 480]", "[0, 480]"), CalibrationSyntax, "no picture size"),
        (("  T_cn_cnm1:", "  T_cam:"), CalibrationField, "cam1 has no T_cn_cnm1"),
        (("  - [0.0, 0.0, 0.0, 1.0]\n", ""), CalibrationSyntax, "cam1.T_cn_cnm1"),
        (("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, 2.0]"), CalibrationValue, "last row"),
        (("[-0.00231207, 0.99989848", "[-0.00231207, 0.9"), CalibrationValue, "R is no rotation"),
        (("-0.11007381", "0.11007381"), CalibrationValue, "stands right of the other"),
        (("-0.11007381", "-110.07381"), CalibrationUnits, "--rig-unit mm"),
        (("-0.11007381", "-.inf"), CalibrationSyntax, "cam1.T_cn_cnm1"),
        (("458.654", "-458.654"), CalibrationValue, "focal lengths -458.654"),
        (("367.215", "1367.215"), CalibrationValue, "principal point"),
        (("458.654", "458,654"), CalibrationSyntax, "5 numbers; wanted 4"),
        (("458.654", "4_58.654"), CalibrationSyntax, "cam0.intrinsics[0], line 6"),
        (("cam1:", "cam2:"), CalibrationField, "wanted cam0, cam1"),
        (("cam1:", "cam0:"), CalibrationField, "'cam0' twice"),
        (("pinhole", "!!python/object/apply:os.system [x]"), CalibrationSyntax, "a tag"),
        (("cam0:", "cam0: &a"), CalibrationSyntax, "an anchor"),
    ],
)  # fmt: skip
def test_mistakes_in_a_camchain_are_named(
    change: tuple[str, str], kind: type[PseudolidarError], words: str, tmp_path: Path
) -> None:
    path = camchain(tmp_path / "camchain.yaml", change)
    with pytest.raises(kind) as error:
        read_any_rig(path)
    assert words in str(error.value)
    assert error.value.path == str(path)


def test_one_camera_alone_is_no_rig(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(CAMCHAIN[: CAMCHAIN.index("cam1:")])
    with pytest.raises(CalibrationField, match="one camera alone"):
        read_any_rig(path)


def test_millimetres_of_a_camchain(tmp_path: Path) -> None:
    path = camchain(tmp_path / "a.yaml", ("-0.11007381", "-110.07381"),
                    ("0.00039912", "0.39912"), ("-0.00085370", "-0.85370"))  # fmt: skip
    rig = read_any_rig(path, unit="mm").raw
    assert rig is not None
    np.testing.assert_allclose(
        rig.T_right_left.translation_m, [-0.11007381, 0.00039912, -0.0008537]
    )


def test_skew_is_nothing_that_kalibr_knows() -> None:
    rig = raw_rig(4)
    K = rig.left.K.copy()
    K[0, 1] = 1.0
    skewed = replace(rig, left=replace(rig.left, K=K))
    with pytest.raises(StructureError, match="skew"):
        camchain_text(skewed)
