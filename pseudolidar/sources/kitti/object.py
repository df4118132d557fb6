"""KITTI object data: single frames, each with its own calibration and labels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.sources.kitti.frames import CalibrationFiles, FrameFiles, KittiFrames, opened
from pseudolidar.sources.kitti.parts import (
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
    stray_note,
)
from pseudolidar.sources.numbered import numbered_files, pair_by_number
from pseudolidar.sources.stamps import synthetic_times

KIND = "kitti-object"
NAME_PARTS = 1  # pictures are called NNNNNN


@dataclass(frozen=True)
class KittiObject:
    """KITTI object data: single frames with labels.

    Args:
        path: the data set's root, or its `training` or `testing`.
        camera: colour where it is there, or one kind.
        split: which half; the one that is there by default, training first.
        rate_hz: frames a second: there are no time stamps.
        limits: caps on the files.
    """

    path: str
    camera: CameraChoice = "auto"
    split: Split | None = None
    rate_hz: float = 10.0
    limits: Limits = DEFAULT_LIMITS

    @classmethod
    def looks_like(cls, path: Path) -> bool:
        """Whether `path` holds pictures `NNNNNN` beside `calib` or `label_2`, by content."""
        return split_folder(path, None, has=_is_split) is not None

    def open(self) -> KittiFrames:
        """List the pairs; calibrations are read frame by frame.

        Raises:
            SourceUnknown: not this layout. SourceEmpty: no pair.
            CalibrationMissing, CalibrationField, CalibrationSyntax, CalibrationValue: no frame
                has a good calibration.
        """
        root = split_or_raise(Path(self.path), self.split, has=_is_split, what="KITTI object")
        # The grey pictures are no part of this data set; used where somebody added them.
        present = [it for it in camera_folders(root) if it.kind == "colour" or it.complete]
        cameras, absent = choose_cameras(self.camera, present, path=root)
        pairs = pair_by_number(cameras.left, cameras.right)
        calibrations = numbered_files(root / "calib", TEXT_SUFFIXES)
        calibrations_or_raise(len(calibrations), calibrations.folder)
        scans = numbered_files(root / "velodyne", SCAN_SUFFIXES)
        labels = numbered_files(root / "label_2", TEXT_SUFFIXES)
        usable = [pair for pair in pairs.pairs if calibrations.get(pair[0])]
        times = synthetic_times(range(len(usable)), self.rate_hz)
        frames = tuple(
            FrameFiles(
                id=left.stem,
                timestamp_ns=times.timestamps_ns[index],
                left=left,
                right=right,
                calibration=CalibrationFiles("object", (calibrations.paths[number],)),
                scan=scans.get(number),
                labels=labels.get(number),
            )
            for index, (number, left, right) in enumerate(usable)
        )
        numbers = [number for number, _, _ in pairs.pairs]
        return opened(
            kind=KIND,
            name=f"KITTI object, {root.name}",
            path=self.path,
            cameras=cameras,
            frames=frames,
            refused=(*pairs.refused, *no_calibration(pairs, calibrations.paths, root / "calib")),
            absent=(
                *absent,
                *absent_part("velodyne", scans, numbers),
                *absent_part("labels", labels, numbers),
            ),
            notes=(
                *pairs.notes,
                *times.notes,
                *stray_note("labels", labels, numbers),
                *stray_note("velodyne", scans, numbers),
            ),
            limits=self.limits,
        )


def _is_split(folder: Path) -> bool:
    beside = any((folder / name).is_dir() for name in ("calib", "label_2"))
    return beside and holds_pictures(folder, NAME_PARTS)
