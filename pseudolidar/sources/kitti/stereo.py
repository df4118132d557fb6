"""KITTI stereo 2012 and 2015: pairs with ground-truth disparity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pseudolidar.errors import SourceEmpty
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.sources.kitti.frames import CalibrationFiles, FrameFiles, KittiFrames, opened
from pseudolidar.sources.kitti.parts import (
    PNG_SUFFIXES,
    SCAN_SUFFIXES,
    TEXT_SUFFIXES,
    CameraChoice,
    Split,
    absent_part,
    calibrations_or_raise,
    camera_folders,
    choose_cameras,
    holds_pictures,
    no_calibration,
    split_folder,
    split_or_raise,
)
from pseudolidar.sources.numbered import (
    FrameNumber,
    NumberedFiles,
    Pairs,
    numbered_files,
    pair_by_number,
)
from pseudolidar.sources.stamps import synthetic_times

KIND = "kitti-stereo"
NAME_PARTS = 2  # pictures are called NNNNNN_10
REFERENCE_INSTANT = 10
# Where 2015 and 2012 keep the ground truth of the reference instant.
TRUTH_FOLDERS = {"occ": ("disp_occ_0", "disp_occ"), "noc": ("disp_noc_0", "disp_noc")}
RAW_FOLDERS = ("calib_cam_to_cam", "calib_velo_to_cam", "calib_imu_to_velo")


@dataclass(frozen=True)
class KittiStereo:
    """KITTI stereo 2012 and 2015: single pairs with ground-truth disparity.

    Args:
        path: the data set's root, or its `training` or `testing`.
        camera: colour where it is there, or one kind.
        split: which half; the one that is there by default, training first.
        instants: which pictures of a scene; 10 has the ground truth, 11 is the next moment.
        truth: ground truth with occluded pixels, or without.
        rate_hz: frames a second: there are no time stamps.
        limits: caps on the files.
    """

    path: str
    camera: CameraChoice = "auto"
    split: Split | None = None
    instants: tuple[int, ...] = (REFERENCE_INSTANT,)
    truth: Literal["occ", "noc"] = "occ"
    rate_hz: float = 10.0
    limits: Limits = DEFAULT_LIMITS

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` holds pictures `NNNNNN_10`, by content."""
        return split_folder(path, None, has=_is_split) is not None

    def open(self) -> KittiFrames:
        """List the pairs; calibrations are read frame by frame.

        Raises:
            SourceUnknown: not this layout. SourceEmpty: no pair.
            CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: no frame
                has a good calibration.
        """
        root = split_or_raise(Path(self.path), self.split, has=_is_split, what="KITTI stereo")
        cameras, absent = choose_cameras(self.camera, camera_folders(root), path=root)
        pairs = self._pairs(cameras.left, cameras.right)
        folder, calibrations = _calibrations(root)
        calibrations_or_raise(len(calibrations), folder)
        scans = numbered_files(root / "velodyne", SCAN_SUFFIXES)
        truth = _truth(root, self.truth)
        usable = [pair for pair in pairs.pairs if pair[0][:1] in calibrations]
        times = synthetic_times(range(len(usable)), self.rate_hz)
        frames = tuple(
            FrameFiles(
                id=left.stem,
                timestamp_ns=times.timestamps_ns[index],
                left=left,
                right=right,
                calibration=calibrations[number[:1]],
                scan=_scan(scans, number),
                truth=truth.get(number),
            )
            for index, (number, left, right) in enumerate(usable)
        )
        reference = [number for number, _, _ in pairs.pairs if number[1] == REFERENCE_INSTANT]
        return opened(
            kind=KIND,
            name=f"KITTI stereo, {root.name}",
            path=self.path,
            cameras=cameras,
            frames=frames,
            refused=(*pairs.refused, *no_calibration(pairs, calibrations, folder)),
            absent=(
                *absent,
                *_absent_scans(scans, reference),
                *absent_part("ground-truth disparity", truth, reference),
            ),
            notes=(*pairs.notes, *times.notes),
            limits=self.limits,
        )

    def _pairs(self, left: NumberedFiles, right: NumberedFiles) -> Pairs:
        pairs = pair_by_number(self._chosen(left), self._chosen(right))
        if not pairs.pairs and not pairs.refused:
            raise SourceEmpty(
                f"no picture of instant {', '.join(map(str, self.instants))}",
                want=f"pictures such as {left.nearest((0, REFERENCE_INSTANT))}",
                fix="Choose others by --instants.",
                path=left.folder,
            )
        return pairs

    def _chosen(self, files: NumberedFiles) -> NumberedFiles:
        return files.only(lambda number: len(number) == NAME_PARTS and number[1] in self.instants)


def _is_split(folder: Path) -> bool:
    return holds_pictures(folder, NAME_PARTS)


def _calibrations(root: Path) -> tuple[Path, Mapping[FrameNumber, CalibrationFiles]]:
    """Calibration by scene and its folder: three files in 2015, one in 2012."""
    cameras, velo, imu = (numbered_files(root / name, TEXT_SUFFIXES) for name in RAW_FOLDERS)
    if len(cameras):
        return cameras.folder, {
            number: CalibrationFiles("raw", (path, velo.get(number), imu.get(number)))
            for number, path in cameras.paths.items()
        }
    single = numbered_files(root / "calib", TEXT_SUFFIXES)
    return single.folder, {
        number: CalibrationFiles("odometry", (path,)) for number, path in single.paths.items()
    }


def _truth(root: Path, kind: Literal["occ", "noc"]) -> NumberedFiles:
    options = [numbered_files(root / name, PNG_SUFFIXES) for name in TRUTH_FOLDERS[kind]]
    found = next((files for files in options if len(files)), options[0])
    return found.only(lambda number: number[1:] == (REFERENCE_INSTANT,))


def _scan(scans: NumberedFiles, number: FrameNumber) -> Path | None:
    """The scan of the same instant; one without an instant is of the reference one."""
    if number[1] == REFERENCE_INSTANT and number not in scans.paths:
        return scans.get(number[:1])
    return scans.get(number)


def _absent_scans(scans: NumberedFiles, numbers: list[FrameNumber]) -> tuple[str, ...]:
    named = scans if any(number in scans.paths for number in numbers) else None
    short = [number[:1] for number in numbers]
    return absent_part("velodyne", scans, numbers if named is not None else short)
