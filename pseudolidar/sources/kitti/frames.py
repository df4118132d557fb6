"""Frames of any KITTI layout: which files belong to them, and how they are loaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Literal

from pseudolidar.errors import PseudolidarError, SourceEmpty
from pseudolidar.formats.labels import read_labels, unknown_classes
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.oxts import OxtsPacket, body_motion, body_pose, read_oxts
from pseudolidar.formats.pictures.disparity_png import read_disparity_png
from pseudolidar.formats.pictures.image import read_image, read_size
from pseudolidar.formats.points.velodyne_bin import read_velodyne_bin
from pseudolidar.formats.rigs.kitti import read_object_calib, read_odometry_calib, read_raw_calib
from pseudolidar.formats.rigs.kitti_calibration import CameraPair, KittiCalibration
from pseudolidar.sources.kitti.parts import CameraFolders
from pseudolidar.sources.source import SourceSummary
from pseudolidar.structures.box import Label
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import LidarScan, StereoFrame
from pseudolidar.structures.motion import BodyMotion
from pseudolidar.structures.pose import Pose

# A run stops at as many bad frames in a row; so opening does not look further for a good one.
FRAMES_TRIED = 20


@dataclass(frozen=True)
class CalibrationFiles:
    """Calibration of one frame, read when the frame is.

    Args:
        layout: format of the files.
        paths: the one file, or cameras, Velodyne, IMU (the last two None where absent).
    """

    layout: Literal["object", "odometry", "raw"]
    paths: tuple[Path | None, ...]

    def read(self, limits: Limits) -> KittiCalibration:
        """The calibration."""
        first = self.paths[0]
        assert first is not None
        match self.layout:
            case "object":
                return read_object_calib(first, limits=limits)
            case "odometry":
                return read_odometry_calib(first, limits=limits)
            case "raw":
                return read_raw_calib(first, *self.paths[1:], limits=limits)


@dataclass(frozen=True, eq=False)
class FrameFiles:
    """The files of one frame.

    Args:
        id: stem of the left picture.
        timestamp_ns: time of the picture.
        left: left picture.
        right: right picture.
        calibration: of the sequence, or the files of the frame's own.
        scan: Velodyne scan.
        scan_timestamp_ns: time of the scan, where it differs.
        turn_ns: when the LiDAR's turn began and ended, where that is known.
        labels: objects.
        truth: ground-truth disparity.
        oxts: position and attitude.
        pose: `T_map_base_link` where it is known beforehand.
    """

    id: str
    timestamp_ns: int
    left: Path
    right: Path
    calibration: KittiCalibration | CalibrationFiles
    scan: Path | None = None
    scan_timestamp_ns: int | None = None
    turn_ns: tuple[int, int] | None = None
    labels: Path | None = None
    truth: Path | None = None
    oxts: Path | None = None
    pose: Pose | None = None


@dataclass(frozen=True, eq=False)
class KittiFrames:
    """An opened KITTI source (`FrameSource`): paths and calibration; pictures are read by `load`.

    Args:
        summary: what it is.
        rig: of the first frame.
        cameras: numbers of the two cameras.
        frames: the files by frame.
        refused: frames without a partner or calibration.
        first_oxts: the packet that `map` is at.
        limits: caps on the files.
    """

    summary: SourceSummary
    rig: StereoRig
    cameras: CameraPair
    frames: tuple[FrameFiles, ...]
    refused: tuple[tuple[str, PseudolidarError], ...] = ()
    first_oxts: OxtsPacket | None = None
    limits: Limits = DEFAULT_LIMITS

    yields: ClassVar = StereoFrame

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """Names of the frames in order."""
        return tuple(files.id for files in self.frames)

    @cached_property
    def timestamps_ns(self) -> tuple[int, ...]:
        """Times of the frames."""
        return tuple(files.timestamp_ns for files in self.frames)

    def pose(self, index: int) -> Pose | None:
        """`T_map_base_link` of frame `index`; None where nobody knows.

        Raises:
            PoseFileError: its packet is damaged.
        """
        pose, _ = self._moving(self.frames[index])
        return pose

    def load(self, index: int) -> StereoFrame:
        """Read and decode frame `index`.

        Raises:
            ImageMissing, ImageUnreadable, ImageFormat, PairMismatch, CalibrationSizeMismatch,
            CalibrationField, CalibrationSyntax, CalibrationValue, LabelError, PointFileTruncated,
            PoseFileError, NotRectified: as they say, with the file.
        """
        files = self.frames[index]
        left = read_image(files.left, limits=self.limits)
        right = read_image(files.right, limits=self.limits)
        height, width = left.pixels.shape[:2]
        calibration = calibration_of(files, self.limits)
        rig = calibration.rig(self.cameras, size_px=(width, height))
        labels = self._labels(files, calibration)
        notes = [
            f"{side}: {note}"
            for side, image in (("left", left), ("right", right))
            for note in image.notes
        ]
        if labels is not None and (unknown := unknown_classes(labels)):
            notes.append(f"labels: classes that KITTI does not have: {', '.join(unknown)}")
        truth = None if files.truth is None else read_disparity_png(files.truth, limits=self.limits)
        pose, motion = self._moving(files)
        try:
            return StereoFrame(
                left=left.pixels,
                right=right.pixels,
                rig=rig,
                id=files.id,
                index=index,
                timestamp_ns=files.timestamp_ns,
                scan=self._scan(files, rig),
                labels=labels,
                pose=pose,
                motion=motion,
                truth=truth,
                notes=tuple(notes),
            )
        except PseudolidarError as error:
            error.located(files.left)
            raise

    def _labels(self, files: FrameFiles, calibration: KittiCalibration) -> tuple[Label, ...] | None:
        if files.labels is None:
            return None
        T_left_cam0 = calibration.T_left_cam0(self.cameras[0])
        return read_labels(files.labels, T_left_cam0=T_left_cam0, limits=self.limits)

    def _scan(self, files: FrameFiles, rig: StereoRig) -> LidarScan | None:
        if files.scan is None or rig.T_left_velodyne is None:
            return None
        stamp_ns = files.scan_timestamp_ns
        if stamp_ns is None:
            stamp_ns = files.timestamp_ns
        scan = read_velodyne_bin(files.scan, timestamp_ns=stamp_ns, limits=self.limits)
        return replace(scan, turn_ns=files.turn_ns)

    def _moving(self, files: FrameFiles) -> tuple[Pose | None, BodyMotion | None]:
        """Where the body is, and how it moves."""
        if files.oxts is None or self.first_oxts is None:
            return files.pose, None
        packet = read_oxts(files.oxts, limits=self.limits)
        return body_pose(packet, self.first_oxts), body_motion(packet)


def calibration_of(files: FrameFiles, limits: Limits) -> KittiCalibration:
    """Calibration of a frame, read where it has its own."""
    calibration = files.calibration
    return calibration if isinstance(calibration, KittiCalibration) else calibration.read(limits)


def opened(
    *,
    kind: str,
    name: str,
    path: str,
    cameras: CameraFolders,
    frames: tuple[FrameFiles, ...],
    refused: tuple[tuple[str, PseudolidarError], ...],
    absent: tuple[str, ...],
    notes: tuple[str, ...],
    first_oxts: OxtsPacket | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> KittiFrames:
    """The opened source: the rig of its first readable frame, and what it is in one line.

    Raises:
        SourceEmpty: no frame is left, with the first reason.
        PseudolidarError: no frame has a readable calibration and picture.
    """
    if not frames:
        raise SourceEmpty(
            f"no usable pair of {len(refused)}" + (f": {refused[0][1]}" if refused else ""),
            want="left and right images of the same number, with a calibration",
            path=path,
        )
    rig = _first_rig(frames, cameras.numbers, limits)
    width, height = rig.left.size_px
    parts = [f"{name}: {len(frames)} pairs of the {cameras.described}", f"{width}x{height} px"]
    parts.append(rig.baseline_text)
    if rig.T_left_velodyne is not None and any(files.scan for files in frames):
        parts.append("Velodyne")
    if first_oxts is not None or any(files.pose for files in frames):
        parts.append("poses")
    if any(files.labels for files in frames):
        parts.append("labels")
    if any(files.truth for files in frames):
        parts.append("ground-truth disparity")
    turning = first_oxts is not None and any(files.turn_ns for files in frames)
    line = ", ".join(parts)
    summary = SourceSummary(kind, path, line, absent, notes, turning_scans=turning)
    return KittiFrames(summary, rig, cameras.numbers, frames, refused, first_oxts, limits)


def _first_rig(frames: Sequence[FrameFiles], cameras: CameraPair, limits: Limits) -> StereoRig:
    """Rig of the first frame that has a readable picture and calibration."""
    first_error: PseudolidarError | None = None
    for files in frames[:FRAMES_TRIED]:
        try:
            calibration = calibration_of(files, limits)
            size_px = calibration.sizes_px.get(cameras[0]) or read_size(files.left, limits=limits)
            return calibration.rig(cameras, size_px=size_px)
        except PseudolidarError as error:
            first_error = first_error or error
    assert first_error is not None
    raise first_error
