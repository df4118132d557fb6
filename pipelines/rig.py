"""Tell what a calibration says, and write it in the form of another program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from pseudolidar.errors import CalibrationField, PseudolidarError
from pseudolidar.formats.pictures.image import read_size
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.rigs.rig_reading import Pictures, RigReading, RigUnit
from pseudolidar.formats.rigs.rig_writers import (
    OF_RECTIFIED,
    RigForm,
    files_of,
    form_of,
    write_any_rig,
)
from pseudolidar.running.field_markers import POSITIONAL, RUN_ONLY, THIS_TIME
from pseudolidar.running.new_file import check_kind, check_new_file, is_text
from pseudolidar.running.reports.rig_report import RigReport
from pseudolidar.sources.folder_layout import list_folders, list_pictures
from pseudolidar.structures.image_size import ImageSize

# Holds any principal point; such a size is never told, nor written.
ANY_SIZE_PX = (100_000, 100_000)
PICTURES_TRIED = 4


@dataclass(frozen=True)
class Rig:
    """Tell what the calibration RIG says of a pair, and what is odd about it; write it elsewhere.

    Cameras, baseline, what one pixel of disparity is worth, and every projection matrix taken apart
    into K, R and t. With --out the calibration is written in the form of another program; what that
    form does not hold is said.

        pseudolidar rig calib.yaml
        pseudolidar rig camchain.yaml --out rig.json
        pseudolidar rig rig.json --out stereo.xml
        pseudolidar rig rig.json --out left.yaml,right.yaml
        pseudolidar rig 2011_09_26 --out camera_info --to ros
        pseudolidar rig P_left.txt,P_right.txt --size 1280x960 --json

    Args:
        rig: a rig.json, OpenCV YAML, XML or JSON, ROS camera_info, Kalibr camchain, K.txt,
            Middlebury's or KITTI's calib.txt, projection matrices as text; a file, a folder, or
            LEFT,RIGHT.
        out: where to write it: a file, a folder (ros, kitti-raw), or LEFT.yaml,RIGHT.yaml.
        to: the form to write: rig, opencv, ros, kalibr, kitti-raw, kitti-odometry, kitti-object,
            k-txt; by default what the name of OUT says.
        size: pictures' size, WIDTHxHEIGHT px, for calibrations that do not say it; by default that
            of pictures beside the file.
        rig_unit: unit of lengths in a calibration that does not say it: m, cm, mm.
        pictures: which cameras are meant where a calibration has both: those of `raw` pictures, or
            of `rectified` ones; `auto` takes the rectified ones first.
        overwrite: replace OUT.
    """

    rig: Annotated[str, POSITIONAL]
    out: Annotated[str | None, RUN_ONLY] = None
    to: RigForm | None = None
    size: ImageSize | None = None
    rig_unit: RigUnit | None = None
    pictures: Pictures = "auto"
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False


def run(job: Rig) -> RigReport:
    """Read, describe, and write what is asked for.

    Raises:
        UsageError: OUT is there already, or its name says no form.
        PseudolidarError: what the reader or the writer refuses.
    """
    form = None if job.out is None else job.to or form_of(job.out)
    for file in () if job.out is None or form is None else files_of(job.out, form):
        check_new_file(file, overwrite=job.overwrite)
        check_kind(file, is_text, "calibration as text")
    found, known_size, notes = _read(job)
    reading = _meant(found, job)
    if job.out is None:
        return RigReport(reading, known_size, None, notes)
    if not known_size and form not in OF_RECTIFIED:
        raise CalibrationField(
            "no image size",
            want=f"the size of the pictures, which {form} says",
            fix="Pass --size WIDTHxHEIGHT.",
            path=job.rig,
        )
    written = write_any_rig(job.out, reading, form=form)
    return RigReport(reading, known_size, written, notes)


def _meant(reading: RigReading, job: Rig) -> RigReading:
    """The reading without the cameras that are not asked for."""
    if job.pictures == "rectified":
        return replace(reading, rectified=reading.of_rectified, raw=None, turns=None)
    if job.pictures == "raw" and reading.raw is None:
        raise CalibrationField(
            f"cameras of rectified pictures alone ({reading.form})",
            want="K, distortion, R and T of the cameras as they are",
            path=job.rig,
        )
    if job.pictures == "raw" and reading.raw is not reading.rectified:
        return replace(reading, rectified=None, turns=None, projections={})
    return reading


def _read(job: Rig) -> tuple[RigReading, bool, tuple[str, ...]]:
    """The calibration, whether the pictures' size is known, and where it was found."""
    given = None if job.size is None else (job.size.width, job.size.height)
    try:
        return read_any_rig(job.rig, size_px=given, unit=job.rig_unit), True, ()
    except CalibrationField as error:
        if given is not None or "image" not in f"{error.got} {error.want}":
            raise
    beside = _size_beside(Path(job.rig.split(",")[0]))
    if beside is not None:
        picture, size_px = beside
        reading = read_any_rig(job.rig, size_px=size_px, unit=job.rig_unit)
        return reading, True, (f"size of the pictures: {picture}",)
    reading = read_any_rig(job.rig, size_px=ANY_SIZE_PX, unit=job.rig_unit)
    return reading, False, ("the file does not say the pictures' size; --size does",)


def _size_beside(path: Path) -> tuple[Path, tuple[int, int]] | None:
    """A picture beside the calibration, or in a folder beside it, and its size."""
    folder = path if path.is_dir() else path.parent
    pictures = list_pictures(folder)[:PICTURES_TRIED]
    for inner in list_folders(folder):
        pictures += list_pictures(inner)[:1]
    for picture in pictures[: 2 * PICTURES_TRIED]:
        try:
            return picture, read_size(picture)
        except PseudolidarError:
            continue
    return None
