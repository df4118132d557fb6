"""KITTI raw data before rectification and synchronisation: drives `..._extract`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from pseudolidar.errors import PseudolidarError, SourceEmpty, SourceUnknown, UsageError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.oxts import OxtsPacket, body_motion, body_pose, read_oxts
from pseudolidar.formats.pictures.image import read_image
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.formats.points.velodyne_txt import read_velodyne_txt
from pseudolidar.formats.rigs.kitti_unrectified import read_unrectified_calib
from pseudolidar.formats.timestamps import NS_PER_S, read_timestamps
from pseudolidar.sources.kitti.drives import (
    calibration_files,
    drive_cameras,
    drives_in,
    is_unrectified,
)
from pseudolidar.sources.kitti.extract_times import TIMES, TimedPair, TimedPairs, timed_pairs
from pseudolidar.sources.kitti.parts import (
    SCAN_SUFFIXES,
    TEXT_SUFFIXES,
    CameraChoice,
    CameraFolders,
    absent_count,
    choose_cameras,
    one_of,
    stray_note,
)
from pseudolidar.sources.kitti.scan_times import (
    ScanTimes,
    TimedScan,
    numbered,
    renumbered_note,
    scans_of_pictures,
)
from pseudolidar.sources.numbered import FrameNumber, NumberedFiles, numbered_files
from pseudolidar.sources.source import SourceSummary
from pseudolidar.sources.timed_pairs import nearest
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import LidarScan, RawPair

KIND = "kitti-extract"
# The IMU's packets come every 10 ms; one that is farther from its picture is of another moment.
PACKET_TOLERANCE_S = 0.02


@dataclass(frozen=True)
class KittiExtract:
    """KITTI raw data before rectification and synchronisation ("extract").

    Args:
        path: a drive, its date folder, or the folder of the dates.
        camera: colour where it is there, or one kind.
        sequence: the drive, `2011_09_26_drive_0002_extract` or `0002`; the only one by default.
        max_skew: eyes whose times differ by more are no pair, s.
        scan_offset: picture n has scan n - this, as a LiDAR that began to turn so many pictures
            later numbers them. By default scans are found by their times, and where they have none
            by the same number.
        rate_hz: frames a second where there are no time stamps.
        limits: caps on the files.
    """

    path: str
    camera: CameraChoice = "auto"
    sequence: str | None = None
    max_skew: float = 0.01
    scan_offset: int | None = None
    rate_hz: float = 10.0
    limits: Limits = DEFAULT_LIMITS

    def __post_init__(self) -> None:
        if not self.max_skew >= 0:
            raise UsageError(f"{self.max_skew:g} s", want="0 or more", where="max_skew")

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether there are drives in `path`, and all of them are unrectified, by content."""
        drives = drives_in(path)
        return bool(drives) and all(is_unrectified(drive) for drive in drives)

    def open(self) -> ExtractFrames:
        """Pair the drive's pictures by time and read its calibration.

        Raises:
            SourceUnknown: no drive. UsageError: several. SourceEmpty: no pair.
            CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: calibration.
            SequenceTime: times.
        """
        drive = _drive(Path(self.path), self.sequence)
        cameras, absent = choose_cameras(self.camera, drive_cameras(drive), path=drive)
        files = calibration_files(drive)
        calibration = read_unrectified_calib(*files.paths, limits=self.limits)
        rig = calibration.rig(cameras.numbers, date=files.date)
        paired = timed_pairs(
            cameras, max_skew_s=self.max_skew, rate_hz=self.rate_hz, limits=self.limits
        )
        if not paired.pairs:
            raise _no_pair(paired, drive)
        scans = _Scans.of(drive, paired.pairs, self.scan_offset, self.limits)
        packets = _packets(drive, paired.pairs, rig, self.limits)
        frames = tuple(
            ExtractFiles(pair, scans.of_pair.get(pair.number), packets.get(pair.number))
            for pair in paired.pairs
        )
        missing = absent_count("velodyne", len(frames) - len(scans.of_pair), len(frames))
        summary = SourceSummary(
            KIND,
            self.path,
            ", ".join(
                _described(drive, len(frames), cameras, rig, bool(scans.of_pair), bool(packets))
            ),
            (*absent, *files.absent, *missing),
            (*paired.notes, *calibration.notes, *scans.notes),
            turning_scans=bool(packets) and scans.turning,
        )
        first = read_oxts(next(iter(packets.values())), limits=self.limits) if packets else None
        return ExtractFrames(summary, rig, frames, paired.refused, first, self.limits)


@dataclass(frozen=True)
class ExtractFiles:
    """The files of one frame.

    Args:
        pair: its pictures.
        scan: Velodyne scan.
        oxts: position and attitude.
    """

    pair: TimedPair
    scan: TimedScan | None
    oxts: Path | None


@dataclass(frozen=True, eq=False)
class ExtractFrames:
    """An opened drive of unrectified pairs.

    Args:
        summary: what it is.
        rig: the cameras as they were mounted, with their distortion.
        frames: the files by frame.
        refused: pictures without a partner.
        first_oxts: the packet that `map` is at.
        limits: caps on the files.
    """

    summary: SourceSummary
    rig: StereoRig
    frames: tuple[ExtractFiles, ...]
    refused: tuple[tuple[str, PseudolidarError], ...] = ()
    first_oxts: OxtsPacket | None = None
    limits: Limits = DEFAULT_LIMITS

    yields: ClassVar = RawPair

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """Names of the frames in order."""
        return tuple(files.pair.left.stem for files in self.frames)

    @cached_property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Times of the left pictures."""
        return tuple(files.pair.timestamp_ns for files in self.frames)

    def load(self, index: int) -> RawPair:
        """Read and decode frame `index`.

        Raises:
            ImageMissing, ImageUnreadable, ImageFormat, PairMismatch, CalibrationSizeMismatch,
            PointFileTruncated, PointFileCorrupt, PoseFileError: as they say, with the file.
        """
        files = self.frames[index]
        left, right = (
            read_image(path, limits=self.limits) for path in (files.pair.left, files.pair.right)
        )
        notes = [
            f"{side}: {note}"
            for side, image in (("left", left), ("right", right))
            for note in image.notes
        ]
        pose = motion = None
        if files.oxts is not None and self.first_oxts is not None:
            packet = read_oxts(files.oxts, limits=self.limits)
            pose, motion = body_pose(packet, self.first_oxts), body_motion(packet)
        try:
            return RawPair(
                left=left.pixels,
                right=right.pixels,
                rig=self.rig,
                id=files.pair.left.stem,
                index=index,
                timestamp_ns=files.pair.timestamp_ns,
                scan=self._scan(files),
                pose=pose,
                motion=motion,
                notes=tuple(notes),
            )
        except PseudolidarError as error:
            raise error.located(files.pair.left) from None

    def _scan(self, files: ExtractFiles) -> LidarScan | None:
        if files.scan is None or self.rig.T_left_velodyne is None:
            return None
        stamp_ns = files.scan.timestamp_ns
        if stamp_ns is None:
            stamp_ns = files.pair.timestamp_ns
        text = files.scan.path.suffix.lower() in TEXT_SUFFIXES
        read = read_velodyne_txt if text else read_velodyne_bin
        scan = read(files.scan.path, timestamp_ns=stamp_ns, limits=self.limits)
        return replace(scan, turn_ns=files.scan.turn_ns)


@dataclass(frozen=True)
class _Scans:
    """Scans by the number of their pair's left picture."""

    of_pair: dict[FrameNumber, TimedScan]
    notes: tuple[str, ...]

    @property
    def turning(self) -> bool:
        """Whether any of them says when its turn began and ended."""
        return any(scan.turn_ns for scan in self.of_pair.values())

    @classmethod
    def of(
        cls, drive: Path, pairs: Sequence[TimedPair], offset: int | None, limits: Limits
    ) -> _Scans:
        folder = drive / "velodyne_points"
        scans = numbered_files(folder / "data", SCAN_SUFFIXES | TEXT_SUFFIXES)
        times = ScanTimes.read(folder, limits)
        numbers = [pair.number for pair in pairs]
        if offset is None:
            stamps = [pair.timestamp_ns for pair in pairs]
            chosen = scans_of_pictures(scans, times, numbers, stamps)
        else:
            moved = ((number, (number[0] - offset,)) for number in numbers)
            chosen = {number: scan for number, scan in moved if scan in scans.paths}
        timed = {number: times.of(scan, scans.paths[scan]) for number, scan in chosen.items()}
        notes = (
            *stray_note("velodyne", scans, chosen.values()),
            *_how(scans, times, chosen, offset),
        )
        return cls(timed, notes)


def _how(
    scans: NumberedFiles,
    times: ScanTimes,
    chosen: dict[FrameNumber, FrameNumber],
    offset: int | None,
) -> tuple[str, ...]:
    """How scans were found, for people."""
    if not len(scans):
        return ()
    if offset is not None:
        return (f"velodyne: picture n has scan {numbered(offset)}, as said",)
    if not times.forward_ns:
        return (
            "velodyne: scans have no times, equal numbers are taken for equal moments; "
            "--scan-offset N takes scan n - N for picture n; `pseudolidar check` finds N",
        )
    return renumbered_note(chosen)


def _packets(
    drive: Path, pairs: Sequence[TimedPair], rig: StereoRig, limits: Limits
) -> dict[FrameNumber, Path]:
    """Packets of the IMU, which measures faster than the cameras, by the pair nearest in time."""
    folder = drive / "oxts"
    packets, times = numbered_files(folder / "data", TEXT_SUFFIXES), folder / TIMES
    calibrated = rig.T_left_velodyne is not None and rig.T_velodyne_imu is not None
    if not (len(packets) and times.is_file() and calibrated):
        return {}
    lines = read_timestamps(times, limits=limits)
    known = [
        (stamp_ns, path)
        for number, path in sorted(packets.paths.items())
        if number[0] < len(lines) and (stamp_ns := lines[number[0]]) is not None
    ]
    known.sort()
    stamps = [stamp_ns for stamp_ns, _ in known]
    tolerance_ns = round(PACKET_TOLERANCE_S * NS_PER_S)
    found = {
        pair.number: nearest(stamps, pair.timestamp_ns, tolerance_ns=tolerance_ns) for pair in pairs
    }
    return {number: known[at][1] for number, at in found.items() if at is not None}


def _described(
    drive: Path,
    pairs: int,
    cameras: CameraFolders,
    rig: StereoRig,
    has_scans: bool,
    has_packets: bool,
) -> list[str]:
    width, height = rig.left.size_px
    apart_m = float(np.linalg.norm(rig.T_right_left.translation_m))
    parts = [f"KITTI raw, {drive.name}: {pairs} unrectified pairs of the {cameras.described}"]
    parts += [f"{width}x{height} px", f"eyes {apart_m:.5f} m apart"]
    parts += ["Velodyne"] if has_scans and rig.T_left_velodyne is not None else []
    return parts + (["poses"] if has_packets else [])


def _drive(root: Path, sequence: str | None) -> Path:
    drives = [drive for drive in drives_in(root) if is_unrectified(drive)]
    if not drives:
        raise SourceUnknown(
            "no unrectified drive of KITTI raw",
            want="a folder with image_00/data and image_01/data, named ..._extract",
            fix="Pass a drive, its date folder, or the folder of the dates.",
            path=root,
        )
    return drives[one_of("drive", [drive.name for drive in drives], sequence, path=root)]


def _no_pair(paired: TimedPairs, drive: Path) -> SourceEmpty:
    first = f": {paired.refused[0][1]}" if paired.refused else ""
    return SourceEmpty(
        f"no usable pair of {len(paired.refused)} pictures{first}",
        want="left and right pictures of the same time",
        path=drive,
    )
