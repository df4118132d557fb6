"""Calibration files of any program: one dispatcher that goes by what is in them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from pseudolidar.errors import (
    CalibrationField,
    CalibrationMissing,
    CalibrationSyntax,
)
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.body_json import MARK, read_pair
from pseudolidar.formats.rigs.euroc import has_sensors, read_sensors, sensor_files
from pseudolidar.formats.rigs.k_txt import read_k_txt
from pseudolidar.formats.rigs.kalibr import is_camchain, read_camchain
from pseudolidar.formats.rigs.key_values import KEY
from pseudolidar.formats.rigs.kitti import (
    CAM_TO_CAM,
    IMU_TO_VELO,
    VELO_TO_CAM,
    read_odometry_calib,
    read_raw_calib,
)
from pseudolidar.formats.rigs.kitti_calibration import CAMERAS, KittiCalibration
from pseudolidar.formats.rigs.middlebury import is_middlebury_calib, read_middlebury_calib
from pseudolidar.formats.rigs.opencv_rig import SUFFIXES, eye_of, read_opencv_rig
from pseudolidar.formats.rigs.projection_pair import read_projection_pair
from pseudolidar.formats.rigs.projection_text import (
    COLUMNS,
    MOST_MATRICES,
    ROWS,
    looks_like_projections,
    read_projections,
)
from pseudolidar.formats.rigs.rig_folder import K_TXT, find_rig, projection_files, storage_files
from pseudolidar.formats.rigs.rig_json import missing_rig, read_rig, rig_notes
from pseudolidar.formats.rigs.rig_reading import RigReading, RigUnit
from pseudolidar.formats.rigs.storage import read_storage
from pseudolidar.formats.text import LONGEST_SHOWN, read_lines
from pseudolidar.structures.camera import StereoRig

# Keys of a rig.json, and those that programs which write matrices as JSON have in their place.
_OWN_KEYS = re.compile(r'"(?:schema|pairs|width_px|baseline_m|T_right_left)"')
_OPENCV_KEYS = re.compile(
    r'"(?:opencv-matrix|R|T|[MKPD]_?[12]|[a-z]+_?(?:matrix|dist)_?[12]'
    r'|(?:[MKDP]|mtx|dist)_?(?:left|right))"',
    re.IGNORECASE,
)
READ = (
    "rig.json, OpenCV YAML, XML or JSON, ROS camera_info, Kalibr's camchain, EuRoC's sensor.yaml "
    "of two cameras, K.txt, Middlebury's or KITTI's calib.txt, two projection matrices as text"
)


def read_any_rig(
    path: str | Path,
    *,
    size_px: tuple[int, int] | None = None,
    unit: RigUnit | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> RigReading:
    """Read the calibration of a pair, whatever program wrote it.

    Args:
        path: a file (of several pairs with the name of one: `rig.json#front`); a folder with
            intrinsics and extrinsics or with a file for each eye; two files with a comma between
            them, the left camera's first.
        size_px: (width, height) of the pictures, for files that do not say it.
        unit: of lengths in files that do not say it.
        limits: cap on the files.

    Raises:
        CalibrationMissing: no such file, or none of a known kind in the folder.
        CalibrationField, CalibrationSyntax, CalibrationValue, CalibrationUnits, LimitError: as
            the format's reader says.
    """
    path = Path(path)
    if not path.exists() and MARK in path.name:
        return _own(path, read_pair(path, limits=limits))
    if not path.exists() and "," in str(path):
        return _two_files(path, size_px, unit, limits)
    if path.is_dir():
        return _folder(path, size_px, unit, limits)
    if not path.exists():
        if path.suffix.lower() == ".json":
            raise missing_rig(path)
        raise CalibrationMissing("no such file", want=READ, path=path)
    lines = read_lines(path, error=CalibrationSyntax, limits=limits)
    words = [line.text for line in lines if line.text.strip(" \t")]
    if not words:
        raise CalibrationSyntax("nothing in the file", want=READ, path=path, where="line 1")
    first = words[0].lstrip(" \t")
    if path.suffix.lower() == ".json" and _is_own(words):
        return _own(path, read_rig(path, limits=limits))
    if first.startswith(("<", "{", "%YAML", "---")) or path.suffix.lower() in SUFFIXES:
        return _storage_file(path, size_px, unit, limits)
    if is_middlebury_calib("\n".join(words)):
        return read_middlebury_calib(path, unit=unit, limits=limits)
    if looks_like_projections(words):
        return _projections(path, size_px, unit, limits)
    if path.name.lower() == K_TXT:
        return read_k_txt(path, size_px=_known(size_px, path), unit=unit, limits=limits)
    if KEY.match(first) and not first[:1].isdigit():
        return _kitti(path, size_px, limits)
    if not any(_starts_number(word) for word in words):
        shown = repr(first[:LONGEST_SHOWN])
        raise CalibrationSyntax(f"a file that begins with {shown}", want=READ, path=path,
                                where="line 1")  # fmt: skip
    if sum(len(line.words()) for line in lines) > 10:
        return _kitti(path, size_px, limits)
    return read_k_txt(path, size_px=_known(size_px, path), unit=unit, limits=limits)


def _starts_number(line: str) -> bool:
    return line.lstrip(" \t")[:1] in "+-.0123456789"


def _own(path: Path, rig: StereoRig) -> RigReading:
    rectified = rig if rig.is_rectified else None
    return RigReading(path, "rig.json", rectified, rig, rig_notes(rig))


def _is_own(lines: list[str]) -> bool:
    """Whether a JSON file is a rig.json, which has a schema, or has matrices by OpenCV's names."""
    text = "\n".join(lines)
    return _OWN_KEYS.search(text) is not None or _OPENCV_KEYS.search(text) is None


def _known(size_px: tuple[int, int] | None, path: Path) -> tuple[int, int]:
    if size_px is None:
        raise CalibrationField(
            "no image size", want="pictures beside the file, which have one", path=path
        )
    return size_px


def _storage_file(
    path: Path, size_px: tuple[int, int] | None, unit: RigUnit | None, limits: Limits
) -> RigReading:
    """One file; where it holds one camera or half of the matrices, with its partner beside it."""
    if is_camchain(read_storage(path, limits=limits)[0]):
        return read_camchain(path, unit=unit, limits=limits)
    try:
        return read_opencv_rig({"": path}, path=path, size_px=size_px, unit=unit, limits=limits)
    except CalibrationField as error:
        partner = _partner(path)
        if partner is None:
            raise error from None
        return read_opencv_rig(partner, path=path, size_px=size_px, unit=unit, limits=limits)


def _partner(path: Path) -> Mapping[str, Path] | None:
    """The files that make a pair with this one: left with right, intrinsics with extrinsics."""
    for mine, other in (("left", "right"), ("right", "left")):
        partner = path.with_name(path.name.replace(mine, other))
        if partner != path and partner.is_file():
            return {mine: path, other: partner}
    for mine, other in (("intrinsic", "extrinsic"), ("extrinsic", "intrinsic")):
        partner = path.with_name(path.name.replace(mine, other))
        if partner != path and partner.is_file():
            return {"": path, "more": partner}
    return None


def _two_files(
    paths: Path, size_px: tuple[int, int] | None, unit: RigUnit | None, limits: Limits
) -> RigReading:
    files = [Path(part) for part in str(paths).split(",")]
    if len(files) == 2 and files[0] == files[1]:
        raise CalibrationField(
            f"{files[0].name} for both cameras",
            want="LEFT,RIGHT, two files",
            fix="Give the file of the other camera.",
            path=paths,
            where="LEFT,RIGHT",
        )
    missing = next((file for file in files if not file.exists()), None)
    if missing is not None or len(files) != 2:
        raise CalibrationMissing(
            "no such file" if missing else f"{len(files)} files",
            want="a calibration, or LEFT,RIGHT",
            path=missing or paths,
        )
    if all(_is_projection(file, limits) for file in files):
        return read_projection_pair(files, size_px=size_px, unit=unit, limits=limits)
    if all(file.suffix.lower() in SUFFIXES for file in files) and has_sensors(
        files[0], files[1], limits=limits
    ):
        return read_sensors(files[0], files[1], unit=unit, limits=limits)
    eyes = {"left": files[0], "right": files[1]}
    if all(eye_of(file.name) is None for file in files):
        try:
            both = {"": files[0], "more": files[1]}
            return read_opencv_rig(both, path=paths, size_px=size_px, unit=unit, limits=limits)
        except CalibrationField:
            pass  # a camera a file: names without an eye
    return read_opencv_rig(eyes, path=paths, size_px=size_px, unit=unit, limits=limits)


def _folder(
    folder: Path, size_px: tuple[int, int] | None, unit: RigUnit | None, limits: Limits
) -> RigReading:
    if (folder / CAM_TO_CAM).exists():
        return _kitti(folder / CAM_TO_CAM, size_px, limits)
    found, sensors = find_rig(folder), sensor_files(folder)
    if found is None and sensors is not None:
        return read_sensors(*sensors, unit=unit, limits=limits)
    if found is None:
        raise CalibrationMissing(f"no calibration in {folder.name}", want=READ, path=folder)
    if found != folder:
        return read_any_rig(found, size_px=size_px, unit=unit, limits=limits)
    files = storage_files(folder)
    if not files:
        both = [*projection_files(folder).values()]
        return read_projection_pair(both, size_px=size_px, unit=unit, limits=limits)
    return read_opencv_rig(files, path=folder, size_px=size_px, unit=unit, limits=limits)


def _is_projection(file: Path, limits: Limits) -> bool:
    """Whether a text file holds a projection matrix: in rows of four, or of KITTI's kind."""
    if file.suffix.lower() in SUFFIXES:
        return False
    lines = [line.text for line in read_lines(file, error=CalibrationSyntax, limits=limits)]
    words = [line for line in lines if line.strip(" \t")]
    in_one_line = len(words) == 1 and len(words[0].split()) == ROWS * COLUMNS
    return in_one_line or looks_like_projections(words)


def _projections(
    path: Path, size_px: tuple[int, int] | None, unit: RigUnit | None, limits: Limits
) -> RigReading:
    """One file: with both matrices, or with one and its partner beside it."""
    files = [path]
    if len(read_projections(path, limits=limits)) < MOST_MATRICES:
        partner = _partner(path) or {}
        files = [partner[eye] for eye in ("left", "right") if eye in partner]
    return read_projection_pair(
        files if len(files) == 2 else [path], size_px=size_px, unit=unit, limits=limits
    )


def _kitti(path: Path, size_px: tuple[int, int] | None, limits: Limits) -> RigReading:
    """KITTI's cameras: colour where they are there, else grey."""
    calibration = _kitti_calibration(path, limits)
    pairs = [CAMERAS[kind] for kind in ("colour", "grey") if calibration.has(CAMERAS[kind])]
    size = calibration.sizes_px.get(pairs[0][0]) if pairs else None
    rig = calibration.rig(pairs[0] if pairs else (0, 1), size_px=size or _known(size_px, path))
    note = f"{path.name}: cameras {pairs[0][0]} and {pairs[0][1]}" if pairs else ""
    named = {f"{calibration.key}{n}": P for n, P in sorted(calibration.projections.items())}
    return RigReading(path, "KITTI", rig, rig, (*calibration.notes, note), projections=named)


def _kitti_calibration(path: Path, limits: Limits) -> KittiCalibration:
    if path.name != CAM_TO_CAM:
        try:
            return read_odometry_calib(path, limits=limits)
        except CalibrationField as error:
            if "S_rect" not in error.got:
                raise
    beside = (path.with_name(name) for name in (VELO_TO_CAM, IMU_TO_VELO))
    velo, imu = (file if file.exists() else None for file in beside)
    return read_raw_calib(path, velo, imu, limits=limits)
