"""KITTI raw data: synchronised, rectified drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pseudolidar.errors import NotRectified, SourceUnknown
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.oxts import OxtsPacket, read_oxts
from pseudolidar.formats.rigs.kitti import read_raw_calib
from pseudolidar.formats.rigs.kitti_calibration import KittiCalibration
from pseudolidar.formats.timestamps import read_timestamps
from pseudolidar.sources.kitti.drives import (
    CalibrationPaths,
    calibration_files,
    date_of,
    drive_cameras,
    drives_in,
    is_unrectified,
)
from pseudolidar.sources.kitti.frames import FrameFiles, KittiFrames, opened
from pseudolidar.sources.kitti.parts import (
    SCAN_SUFFIXES,
    TEXT_SUFFIXES,
    CameraChoice,
    absent_count,
    absent_part,
    choose_cameras,
    one_of,
    stray_note,
)
from pseudolidar.sources.kitti.scan_times import ScanTimes, renumbered_note, scans_of_pictures
from pseudolidar.sources.numbered import FrameNumber, NumberedFiles, numbered_files, pair_by_number
from pseudolidar.sources.stamps import FrameTimes, read_frame_times, synthetic_times

KIND = "kitti-raw"


@dataclass(frozen=True)
class KittiRaw:
    """KITTI raw data, synchronised and rectified drives.

    Args:
        path: a drive, its date folder, or the folder of the dates.
        camera: colour where it is there, or one kind.
        sequence: the drive, `2011_09_26_drive_0002_sync` or `0002`; the only one by default.
        rate_hz: frames a second where there are no time stamps.
        limits: caps on the files.
    """

    path: str
    camera: CameraChoice = "auto"
    sequence: str | None = None
    rate_hz: float = 10.0
    limits: Limits = DEFAULT_LIMITS

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether there are drives in `path`, by content."""
        return bool(drives_in(path))

    def open(self) -> KittiFrames:
        """List the drive's pairs and read its calibration, times and where it has them.

        Raises:
            SourceUnknown: no drive. UsageError: several. SourceEmpty: no pair.
            CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: calibration.
            NotRectified: the drive is of the unrectified data ("extract").
            SequenceTime: times.
        """
        root = Path(self.path)
        drive = _drive(root, self.sequence)
        _refuse_unrectified(drive, self.limits)
        cameras, absent = choose_cameras(self.camera, drive_cameras(drive), path=drive)
        files = calibration_files(drive)
        calibration = _calibration(files, self.limits)
        pairs = pair_by_number(cameras.left, cameras.right)
        numbers = [number for number, _, _ in pairs.pairs]
        times = _times(cameras.left.folder.parent, numbers, self.rate_hz, self.limits)
        scans = numbered_files(drive / "velodyne_points" / "data", SCAN_SUFFIXES)
        scan_times = ScanTimes.read(drive / "velodyne_points", self.limits)
        scan_of = scans_of_pictures(scans, scan_times, numbers, times.timestamps_ns)
        timed = {n: scan_times.of(scan, scans.paths[scan]) for n, scan in scan_of.items()}
        packets = numbered_files(drive / "oxts" / "data", TEXT_SUFFIXES)
        first_oxts = _first_oxts(packets, numbers, calibration, self.limits)
        frames = tuple(
            FrameFiles(
                id=left.stem,
                timestamp_ns=stamp_ns,
                left=left,
                right=right,
                calibration=calibration,
                scan=None if (scan := timed.get(number)) is None else scan.path,
                scan_timestamp_ns=None if scan is None else scan.timestamp_ns,
                turn_ns=None if scan is None else scan.turn_ns,
                oxts=packets.get(number),
            )
            for (number, left, right), stamp_ns in zip(
                pairs.pairs, times.timestamps_ns, strict=True
            )
        )
        return opened(
            kind=KIND,
            name=f"KITTI raw, {drive.name}",
            path=self.path,
            cameras=cameras,
            frames=frames,
            refused=pairs.refused,
            absent=(
                *absent,
                *files.absent,
                *absent_count("velodyne", len(numbers) - len(scan_of), len(numbers)),
                *absent_part("oxts", packets, numbers),
            ),
            notes=(
                *pairs.notes,
                *times.notes,
                *calibration.notes,
                *_date_note(drive, calibration),
                *stray_note("velodyne", scans, scan_of.values()),
                *renumbered_note(scan_of),
                *scan_times.notes,
            ),
            first_oxts=first_oxts,
            limits=self.limits,
        )


def _drive(root: Path, sequence: str | None) -> Path:
    drives = drives_in(root)
    if not drives:
        raise SourceUnknown(
            "no drive of KITTI raw",
            want="a folder with image_02/data and image_03/data",
            fix="Pass a drive, its date folder, or the folder of the dates.",
            path=root,
        )
    rectified = [drive for drive in drives if not is_unrectified(drive)]
    drives = rectified or drives
    return drives[one_of("drive", [drive.name for drive in drives], sequence, path=root)]


def _calibration(files: CalibrationPaths, limits: Limits) -> KittiCalibration:
    return replace(read_raw_calib(*files.paths, limits=limits), date=files.date)


def _refuse_unrectified(drive: Path, limits: Limits) -> None:
    if is_unrectified(drive, limits):
        raise NotRectified(
            "a drive of the unrectified data",
            want="a synchronised and rectified one (drive_NNNN_sync)",
            fix="Read it with --source kitti-extract, or get the sync version of this drive.",
            path=drive,
        )


def _times(
    camera: Path, numbers: Sequence[FrameNumber], rate_hz: float, limits: Limits
) -> FrameTimes:
    indices = [number[0] for number in numbers]
    path = camera / "timestamps.txt"
    if indices and path.is_file():
        return read_frame_times(path, read_timestamps(path, limits=limits), indices)
    return synthetic_times([index - indices[0] for index in indices], rate_hz)


def _first_oxts(
    packets: NumberedFiles,
    numbers: Sequence[FrameNumber],
    calibration: KittiCalibration,
    limits: Limits,
) -> OxtsPacket | None:
    """The packet of the first frame that has one, where the IMU is calibrated to the cameras."""
    first = next((path for number in numbers if (path := packets.get(number))), None)
    if first is None or calibration.T_velodyne_imu is None or calibration.T_cam0_velodyne is None:
        return None
    return read_oxts(first, limits=limits)


def _date_note(drive: Path, calibration: KittiCalibration) -> tuple[str, ...]:
    """Whether the drive is of another date than the calibration."""
    own = date_of(drive)
    if not own or not calibration.date or own == calibration.date:
        return ()
    return (f"warning: the calibration is of {calibration.date}, the drive of {own}",)
