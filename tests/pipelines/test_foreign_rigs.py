"""`--rig` with calibrations of other programs: the same bytes as with a rig.json, or the reason."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pseudolidar.cli import main
from pseudolidar.formats.rigs.k_txt import write_k_txt
from pseudolidar.formats.rigs.kitti import write_odometry_calib
from pseudolidar.formats.rigs.middlebury import write_middlebury_calib
from pseudolidar.formats.rigs.opencv_rig_writers import write_camera_info, write_opencv
from pseudolidar.formats.rigs.rig_json import read_rig
from pseudolidar.formats.rigs.rig_reading import unchanged
from pseudolidar.structures.camera import StereoRig


def opencv(path: Path, rig: StereoRig, *, unit: float = 1.0) -> Path:
    """The rig as OpenCV itself writes it, lengths in `unit` a metre."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    P2 = rig.P_right * np.array([1, 1, 1, unit])
    for name, value in (("P1", rig.P_left), ("P2", P2)):
        storage.write(name, value)
    storage.release()
    return path


def ours(path: Path, rig: StereoRig) -> Path:
    write_opencv(path, rig)
    return path


def ros(folder: Path, rig: StereoRig) -> Path:
    write_camera_info(folder / "left.yaml", folder / "right.yaml", unchanged(rig))
    return folder


def k_txt(path: Path, rig: StereoRig) -> Path:
    write_k_txt(path, rig)
    return path


def middlebury(path: Path, rig: StereoRig) -> Path:
    write_middlebury_calib(path, rig, ndisp=33)
    return path


def kitti(path: Path, rig: StereoRig) -> Path:
    write_odometry_calib(path, rig)
    return path


FORMS: dict[str, Callable[[Path, StereoRig], Path]] = {
    "OpenCV YAML": lambda folder, rig: opencv(folder / "a.yml", rig),
    "OpenCV XML": lambda folder, rig: opencv(folder / "a.xml", rig),
    "OpenCV JSON": lambda folder, rig: opencv(folder / "a.json", rig),
    "our YAML": lambda folder, rig: ours(folder / "a.yaml", rig),
    "ROS camera_info": ros,
    "K.txt": lambda folder, rig: k_txt(folder / "K.txt", rig),
    "Middlebury": lambda folder, rig: middlebury(folder / "calib.txt", rig),
    "KITTI": lambda folder, rig: kitti(folder / "calib.txt", rig),
}


def clouds(drive: Path, out: Path, *flags: str) -> dict[str, bytes]:
    command = ["convert", str(drive), str(out), "--frames", "0:2", "--to", "pcd,disparity"]
    assert main([*command, "--min-depth", "3", *flags]) == 0
    return {file.name: file.read_bytes() for file in sorted(out.glob("[dp]*/*"))}


@pytest.fixture(scope="module")
def want(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What the drive's own rig.json gives."""
    return clouds(drive, tmp_path_factory.mktemp("want") / "out")


@pytest.mark.parametrize("form", list(FORMS))
def test_the_same_bytes_by_any_form(
    form: str, drive: Path, want: dict[str, bytes], tmp_path: Path
) -> None:
    (tmp_path / "rig").mkdir()
    place = FORMS[form](tmp_path / "rig", read_rig(drive / "rig.json"))
    assert len(want) == 4
    assert clouds(drive, tmp_path / "got", "--rig", str(place)) == want
    # ... and found in the folder of the pictures by itself
    copy = tmp_path / "drive"
    shutil.copytree(drive, copy)
    (copy / "rig.json").unlink()
    for file in (tmp_path / "rig").iterdir():
        name = file.name if form != "OpenCV JSON" else "stereo.json"
        shutil.copy(file, copy / (f"stereo{file.suffix}" if file.stem == "a" else name))
    assert clouds(copy, tmp_path / "found") == want


def refusal(capsys: pytest.CaptureFixture[str], drive: Path, out: Path, *flags: str) -> dict:
    capsys.readouterr()
    assert main(["convert", str(drive), str(out), "--json", *flags]) == 3
    return json.loads(capsys.readouterr().out)["error"]


def test_millimetres_are_asked_about(
    drive: Path, want: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = opencv(tmp_path / "mm.yml", read_rig(drive / "rig.json"), unit=1000.0)
    error = refusal(capsys, drive, tmp_path / "out", "--rig", str(path))
    assert error["code"] == "CalibrationUnits"
    assert "500 mm, 0.5 m? Then pass --rig-unit mm" in error["fix"]
    assert not (tmp_path / "out").exists()
    assert clouds(drive, tmp_path / "got", "--rig", str(path), "--rig-unit", "mm") == want


def test_exchanged_unrectified_malformed_and_hostile_files_are_named(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = read_rig(drive / "rig.json")

    def code(path: Path) -> tuple[str, str]:
        error = refusal(capsys, drive, tmp_path / "out", "--rig", str(path))
        return error["code"], f"{error['where']} {error['got']} {error['want']}"

    exchanged = opencv(tmp_path / "exchanged.yml", rig, unit=-1.0)
    kind, text = code(exchanged)
    assert (kind, "stands right of the other" in text) == ("CalibrationValue", True)
    raw = tmp_path / "raw.xml"
    storage = cv2.FileStorage(str(raw), cv2.FILE_STORAGE_WRITE)
    values = {"M1": rig.left.K, "M2": rig.right.K, "D1": np.full((1, 5), 0.1)}
    values |= {"D2": np.full((1, 5), 0.1), "R": np.eye(3), "T": np.array([[-0.5], [0], [0]])}
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    refused = refusal(
        capsys, drive, tmp_path / "out", "--rig", str(raw), "--rectify.pictures", "rectified"
    )
    assert refused["code"] == "NotRectified"
    hostile = {
        "tag.yml": ("M1: !!python/object/apply:os.system ['id']\n", "a tag"),
        "bomb.yml": ("a: &a [1]\nb: [*a, *a]\n", "an anchor"),
        "deep.yml": ("a: " + "[" * 20_000, "32 levels"),
        "cols.yml": (exchanged.read_text().replace("cols: 4", "cols: -4", 1), "cols -4"),
        "huge.yml": (exchanged.read_text().replace("rows: 3", "rows: 1000000", 1), "1000000"),
        "xxe.xml": ('<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hosts">]><a>&b;</a>', "line 1"),
    }
    for name, (content, words) in hostile.items():
        (tmp_path / name).write_text(content)
        kind, text = code(tmp_path / name)
        assert kind in ("CalibrationSyntax", "CalibrationValue"), name
        assert words in text, name
