"""One writer of rigs for every form that is written: by name, with what the form cannot hold."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.rigs.k_txt import write_k_txt
from pseudolidar.formats.rigs.kalibr import write_camchain
from pseudolidar.formats.rigs.kitti import (
    CAM_TO_CAM,
    IMU_TO_VELO,
    VELO_TO_CAM,
    write_object_calib,
    write_odometry_calib,
    write_raw_calib,
)
from pseudolidar.formats.rigs.opencv_rig_writers import write_camera_info, write_opencv
from pseudolidar.formats.rigs.rig_json import write_rig
from pseudolidar.formats.rigs.rig_reading import RigReading, unchanged
from pseudolidar.geometry.rectification import Rectification, aligning_rotations, rectification
from pseudolidar.structures.camera import StereoRig

RigForm = Literal[
    "rig", "opencv", "ros", "kalibr", "kitti-raw", "kitti-odometry", "kitti-object", "k-txt"
]
# Forms that say how unrectified pictures are rectified, and those that have rectified ones alone.
OF_BOTH, OF_RECTIFIED = ("opencv", "ros", "kitti-raw"), ("kitti-odometry", "kitti-object", "k-txt")
_OBJECT_FILE = re.compile(r"[0-9]{6}\.txt")
_WITH_LIDAR = ("rig", "kitti-raw", "kitti-odometry", "kitti-object")


@dataclass(frozen=True)
class WrittenRig:
    """What was written.

    Args:
        form: of the files.
        files: where they are.
        notes: what was computed for it, and what the form cannot hold.
    """

    form: RigForm
    files: tuple[Path, ...]
    notes: tuple[str, ...]


def form_of(out: str) -> RigForm:
    """The form that a name stands for.

    Raises:
        UsageError: it stands for none.
    """
    path = Path(out)
    name, suffix = path.name.lower(), path.suffix.lower()
    if "," in out:
        return "ros"
    if suffix == ".json":
        return "rig"
    if suffix in (".yml", ".xml", ".yaml"):
        return "kalibr" if "camchain" in name else "opencv"
    by_name: dict[str, RigForm] = {
        "calib.txt": "kitti-odometry",
        CAM_TO_CAM: "kitti-raw",
        "k.txt": "k-txt",
    }
    if name in by_name:
        return by_name[name]
    if _OBJECT_FILE.fullmatch(name):
        return "kitti-object"
    raise UsageError(
        f"no calibration is called {path.name!r}",
        want=f"--to, one of {', '.join(get_args(RigForm))}",
        fix="Or a name that says it: rig.json, stereo.yaml, stereo.xml, LEFT.yaml,RIGHT.yaml, "
        "camchain.yaml, calib.txt, calib_cam_to_cam.txt, K.txt.",
        path=out,
    )


def files_of(out: str, form: RigForm) -> tuple[Path, ...]:
    """The files that a form may have; of KITTI's raw data some are left out where nothing is known.

    Raises:
        UsageError: two files for a form of one.
    """
    files = [Path(part) for part in out.split(",")]
    if form == "ros" and len(files) == 1:
        return files[0] / "left.yaml", files[0] / "right.yaml"
    if len(files) != (2 if form == "ros" else 1) or len({*files}) < len(files):
        want = "a folder, or LEFT.yaml,RIGHT.yaml" if form == "ros" else "one"
        raise UsageError(f"{len(files)} files for {form}", want=want, path=out)
    if form == "kitti-raw":
        folder = files[0].parent if files[0].name == CAM_TO_CAM else files[0]
        return tuple(folder / name for name in (CAM_TO_CAM, VELO_TO_CAM, IMU_TO_VELO))
    return tuple(files)


def write_any_rig(
    out: str, reading: RigReading, *, form: RigForm | None = None, calib_time: str = ""
) -> WrittenRig:
    """Write a calibration in another form.

    Args:
        out: file; folder for `ros` (left.yaml and right.yaml go there) and `kitti-raw`; two files
            with a comma between them for `ros`.
        reading: what was read. Forms for unrectified cameras get them where they are known.
        form: by default what the name says.
        calib_time: time of making for KITTI's files.

    Raises:
        UsageError: the name says no form; two files for a form of one.
        NotRectified, CalibrationField, StructureError: the form cannot hold this rig.
        CalibrationUnits: lengths that are no metres, in a form that has metres.
        OutputError: a file cannot be written.
    """
    form = form or form_of(out)
    if form != "rig":
        reading.of_pictures.check_metric()
    notes: list[str] = []
    path, files = Path(out), files_of(out, form)
    match form:
        case "rig":
            write_rig(path, _one_rig(reading, notes))
        case "opencv":
            write_opencv(path, reading.raw or reading.of_rectified, _known_plan(reading))
        case "ros":
            write_camera_info(files[0], files[1], _plan(reading, notes))
        case "kalibr":
            write_camchain(path, _one_rig(reading, notes))
        case "kitti-raw":
            plan = _plan(reading, notes)
            folder = files[0].parent
            write_raw_calib(folder, plan.raw, rectified=plan, calib_time=calib_time)
            files = tuple(file for file in files if file.exists())
        case "kitti-odometry":
            write_odometry_calib(path, reading.of_rectified)
        case "kitti-object":
            write_object_calib(path, reading.of_rectified)
        case "k-txt":
            write_k_txt(path, reading.of_rectified)
    return WrittenRig(form, files, (*notes, *_lost(reading, form)))


def _one_rig(reading: RigReading, notes: list[str]) -> StereoRig:
    """The rig of a form that holds one: of rectified pictures first, as everywhere."""
    raw, rectified = reading.raw, reading.rectified
    if rectified is None:
        assert raw is not None
        return raw
    if raw is not None and raw is not rectified:
        notes.append("the cameras of the rectified pictures are written, not those as taken")
    return rectified


def _known_plan(reading: RigReading) -> Rectification | None:
    """How the file says that its pictures are rectified; None where it does not."""
    raw, rectified = reading.raw, reading.rectified
    if rectified is None:
        return None
    if raw is None or raw is rectified:
        return unchanged(rectified)
    turns = reading.turns or aligning_rotations(raw.T_right_left)
    return Rectification(raw, rectified, *turns)


def _plan(reading: RigReading, notes: list[str]) -> Rectification:
    known = _known_plan(reading)
    if known is not None:
        return known
    assert reading.raw is not None
    plan = rectification(reading.raw)
    notes.append(
        "the rectification is computed (alpha 0): "
        f"f {plan.rig.left.focal_px:.2f} px, baseline {plan.rig.baseline_m:.5g} m"
    )
    return plan


def _lost(reading: RigReading, form: RigForm) -> list[str]:
    """What the rig has and the form has not."""
    if form == "rig":
        return []
    rig = reading.of_pictures
    lost = {
        "the disparity correction": rig.correction is not None,
        "the row correction": rig.rows is not None,
        "the quality of the calibration": rig.quality is not None,
        "the Velodyne's place": rig.T_left_velodyne is not None and form not in _WITH_LIDAR,
        "the IMU's place": rig.T_velodyne_imu is not None
        and form not in ("kitti-raw", "kitti-object"),
        "the sizes of the pictures": form in OF_RECTIFIED,
        "that the rectified eyes have one size": form == "ros"
        and rig.left.size_px != rig.right.size_px,
        "what stands off the row": form == "k-txt"
        and bool(np.abs(rig.T_right_left.translation_m[1:]).any()),
    }
    words = [name for name, there in lost.items() if there]
    return [f"{form} does not hold {', '.join(words)}"] if words else []
