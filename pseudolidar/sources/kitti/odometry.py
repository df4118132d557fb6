"""KITTI odometry: long sequences, grey or colour, with the camera's true path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pseudolidar.errors import CalibrationMissing, PoseFileError, SourceUnknown
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.pictures.image import read_size
from pseudolidar.formats.rigs.kitti import read_odometry_calib
from pseudolidar.formats.rigs.kitti_calibration import KittiCalibration
from pseudolidar.formats.timestamps import read_times
from pseudolidar.formats.trajectory import body_poses, read_kitti_poses
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.sources.kitti.frames import FrameFiles, KittiFrames, opened
from pseudolidar.sources.kitti.parts import (
    SCAN_SUFFIXES,
    CameraChoice,
    CameraFolders,
    absent_part,
    camera_folders,
    choose_cameras,
    holds_pictures,
    one_of,
    stray_note,
)
from pseudolidar.sources.numbered import FrameNumber, numbered_files, pair_by_number
from pseudolidar.sources.stamps import FrameTimes, read_frame_times, synthetic_times
from pseudolidar.structures.pose import Pose

KIND = "kitti-odometry"
NAME_PARTS = 1  # pictures are called NNNNNN


@dataclass(frozen=True)
class KittiOdometry:
    """KITTI odometry sequences.

    Args:
        path: the data set's root, its `sequences`, or one of them.
        camera: colour where it is there, or one kind.
        sequence: such as `06`; the only one by default.
        rate_hz: frames a second where there is no times.txt.
        limits: caps on the files.
    """

    path: str
    camera: CameraChoice = "auto"
    sequence: str | None = None
    rate_hz: float = 10.0
    limits: Limits = DEFAULT_LIMITS

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether there are sequences in `path`, by content."""
        return bool(_sequences(path))

    def open(self) -> KittiFrames:
        """List the pairs and read calibration, times and poses of the sequence.

        Raises:
            SourceUnknown: no sequence. UsageError: several. SourceEmpty: no pair.
            CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: calibration.
            SequenceTime: times. PoseFileError: poses.
        """
        folder = _sequence(Path(self.path), self.sequence)
        calibration = _calibration(folder, self.limits)
        cameras, absent = choose_cameras(
            self.camera, camera_folders(folder), path=folder, calibrated=calibration.has
        )
        pairs = pair_by_number(cameras.left, cameras.right)
        numbers = [number for number, _, _ in pairs.pairs]
        times = _times(folder / "times.txt", numbers, self.rate_hz, self.limits)
        scans = numbered_files(folder / "velodyne", SCAN_SUFFIXES)
        poses = _poses(folder, cameras, calibration, numbers, self.limits)
        frames = tuple(
            FrameFiles(
                id=left.stem,
                timestamp_ns=stamp_ns,
                left=left,
                right=right,
                calibration=calibration,
                scan=scans.get(number),
                pose=poses[number[0]] if poses else None,
            )
            for (number, left, right), stamp_ns in zip(
                pairs.pairs, times.timestamps_ns, strict=True
            )
        )
        return opened(
            kind=KIND,
            name=f"KITTI odometry, sequence {folder.resolve().name}",
            path=self.path,
            cameras=cameras,
            frames=frames,
            refused=pairs.refused,
            absent=(
                *absent,
                *absent_part("velodyne", scans, numbers),
                *(("calibration Tr",) if calibration.T_cam0_velodyne is None else ()),
                *(() if poses else ("poses",)),
            ),
            notes=(
                *pairs.notes,
                *times.notes,
                *calibration.notes,
                *stray_note("velodyne", scans, numbers),
            ),
            limits=self.limits,
        )


def _sequences(path: Path) -> list[Path]:
    """Sequence folders: `path` itself, or below it, `sequences` or `dataset/sequences`."""
    if _is_sequence(path):
        return [path]
    found: list[Path] = []
    for parent in (path / "sequences", path / "dataset" / "sequences", path):
        if not found and parent.is_dir():
            folders = sorted(child for child in parent.iterdir() if child.name.isdecimal())
            found = [folder for folder in folders if _is_sequence(folder)]
    return found


def _is_sequence(path: Path) -> bool:
    """Pictures beside one calibration for all, or in a folder named by a number."""
    if (path / "calib").is_dir() or not holds_pictures(path, NAME_PARTS):
        return False
    named = path.resolve().name.isdecimal()
    return named or any((path / name).is_file() for name in ("calib.txt", "times.txt"))


def _sequence(path: Path, wanted: str | None) -> Path:
    sequences = _sequences(path)
    if not sequences:
        raise SourceUnknown(
            "no sequence of KITTI odometry",
            want="a folder with image_0 and image_1, or image_2 and image_3, and calib.txt",
            fix="Pass a sequence, or the folder of the sequences.",
            path=path,
        )
    names = [folder.resolve().name for folder in sequences]
    return sequences[one_of("sequence", names, wanted, path=path)]


def _calibration(folder: Path, limits: Limits) -> KittiCalibration:
    path = folder / "calib.txt"
    if not path.is_file():
        raise CalibrationMissing(
            "no calib.txt",
            want="calib.txt in the sequence",
            fix="Get the calibration, a separate download.",
            path=path,
        )
    return read_odometry_calib(path, limits=limits)


def _times(
    path: Path, numbers: Sequence[FrameNumber], rate_hz: float, limits: Limits
) -> FrameTimes:
    indices = [number[0] for number in numbers]
    if indices and path.is_file():
        return read_frame_times(path, read_times(path, limits=limits), indices).after_zero()
    return synthetic_times([index - indices[0] for index in indices], rate_hz)


def _poses(
    folder: Path,
    cameras: CameraFolders,
    calibration: KittiCalibration,
    numbers: Sequence[FrameNumber],
    limits: Limits,
) -> tuple[Pose, ...]:
    """`T_map_base_link` by frame number; none where the sequence has no pose file."""
    name = folder.resolve().name
    path = folder.resolve().parent.parent / "poses" / f"{name}.txt"
    if not numbers or not path.is_file():
        return ()
    camera_poses = read_kitti_poses(path, limits=limits)
    frames = numbers[-1][0] + 1
    if len(camera_poses) < frames:
        raise PoseFileError(
            f"{len(camera_poses)} poses",
            want=f"at least {frames}, as there is a frame {frames - 1}",
            fix="Copy the file again, or remove it to go without poses.",
            path=path,
            where=f"row {len(camera_poses) + 1}",
        )
    size_px = read_size(cameras.left.paths[numbers[0]], limits=limits)
    rig = calibration.rig(cameras.numbers, size_px=size_px)
    left = cameras.numbers[0]
    return body_poses(camera_poses, left_in_base_link(rig) @ calibration.T_left_cam0(left))
