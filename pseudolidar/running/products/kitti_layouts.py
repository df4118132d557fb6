"""Frames as the files of KITTI's data sets: what each layout holds, and where."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from pseudolidar.formats.labels import encode_labels
from pseudolidar.formats.oxts import OxtsPacket, packet_at, write_oxts
from pseudolidar.formats.pictures.disparity_png import encode_disparity_png
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.velodyne_bin import encode_velodyne_bin
from pseudolidar.formats.rigs.kitti import write_object_calib, write_odometry_calib, write_raw_calib
from pseudolidar.formats.rigs.kitti_calibration import FRAME_CAM0
from pseudolidar.formats.timestamps import NS_PER_S, write_times, write_timestamps
from pseudolidar.formats.trajectory import camera_poses, write_kitti_poses
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.product import Product
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

KittiLayout = Literal["raw", "odometry", "object", "stereo"]
# Where a world lies on the earth: OXTS packets need a place. Karlsruhe, as KITTI does.
START = OxtsPacket(49.0, 8.4, 115.0, 0.0, 0.0, 0.0)
SEQUENCE = "00"


@dataclass(frozen=True, eq=False)
class Drive:
    """What all frames of a drive share.

    Args:
        rig: with a Velodyne.
        timestamps_ns: of the frames.
        poses: `T_map_base_link` of the frames.
        number: of the drive, for the name of its folder.
    """

    rig: StereoRig
    timestamps_ns: tuple[int, ...]
    poses: tuple[Pose, ...]
    number: int = 0

    @property
    def raw_folder(self) -> str:
        """`DATE/DATE_drive_NNNN_sync` of the raw data."""
        start = datetime.fromtimestamp(self.timestamps_ns[0] // NS_PER_S, UTC)
        return f"{start:%Y_%m_%d}/{start:%Y_%m_%d}_drive_{self.number:04d}_sync"


def write_shared(layout: KittiLayout, folder: Path, drive: Drive) -> None:
    """Write what belongs to no single picture: calibration, times, poses.

    Raises:
        OutputError: the folder cannot be written to.
    """
    _SHARED[layout](folder, drive)


@dataclass(frozen=True)
class EncodeFrame:
    """One frame to the bytes of its files in a layout: pure, picklable, one thread.

    Args:
        layout: which data set.
        raw_folder: `Drive.raw_folder`.
    """

    layout: KittiLayout
    raw_folder: str

    def __call__(self, frame: StereoFrame) -> Product:
        """Both pictures, the scan, and of labels and truth what the layout has."""
        name = f"{frame.index:010d}" if self.layout == "raw" else f"{frame.index:06d}"
        left, right, scan = (
            folder.format(name=name, raw=self.raw_folder) for folder in _PLACES[self.layout]
        )
        files = [
            OutputFile.of(left, encode_png(frame.left)),
            OutputFile.of(right, encode_png(frame.right)),
        ]
        if frame.scan is not None:
            files.append(OutputFile.of(scan, encode_velodyne_bin(frame.scan)))
        if self.layout == "object" and frame.labels is not None:
            files.append(OutputFile.of(f"training/label_2/{name}.txt", encode_labels(frame.labels)))
        if self.layout == "stereo" and frame.truth is not None:
            truth = encode_disparity_png(frame.truth)
            files.append(OutputFile.of(f"training/disp_occ_0/{name}_10.png", truth))
        return Product(tuple(files))


# Left picture, right picture, scan.
_PLACES: dict[KittiLayout, tuple[str, str, str]] = {
    "raw": (
        "{raw}/image_02/data/{name}.png",
        "{raw}/image_03/data/{name}.png",
        "{raw}/velodyne_points/data/{name}.bin",
    ),
    "odometry": (
        f"sequences/{SEQUENCE}/image_2/{{name}}.png",
        f"sequences/{SEQUENCE}/image_3/{{name}}.png",
        f"sequences/{SEQUENCE}/velodyne/{{name}}.bin",
    ),
    "object": (
        "training/image_2/{name}.png",
        "training/image_3/{name}.png",
        "training/velodyne/{name}.bin",
    ),
    "stereo": (
        "training/image_2/{name}_10.png",
        "training/image_3/{name}_10.png",
        "training/velodyne/{name}_10.bin",
    ),
}


def _raw(folder: Path, drive: Drive) -> None:
    """The IMU stands where the Velodyne does: raw data has poses only of an IMU."""
    place = folder / drive.raw_folder
    imu = Pose.identity("velodyne", "imu")
    write_raw_calib(place.parent, replace(drive.rig, T_velodyne_imu=imu))
    for part in ("image_02", "image_03", "velodyne_points", "oxts"):
        write_timestamps(place / part / "timestamps.txt", drive.timestamps_ns)
    for index, pose in enumerate(drive.poses):
        write_oxts(place / "oxts" / "data" / f"{index:010d}.txt", packet_at(pose, START))


def _odometry(folder: Path, drive: Drive) -> None:
    """Poses are of the left camera, times count from the first frame."""
    place = folder / "sequences" / SEQUENCE
    write_odometry_calib(place / "calib.txt", drive.rig)
    start_ns = drive.timestamps_ns[0]
    write_times(place / "times.txt", [stamp - start_ns for stamp in drive.timestamps_ns])
    T_base_link_cam0 = replace(left_in_base_link(drive.rig), src=FRAME_CAM0)
    poses = camera_poses(drive.poses, T_base_link_cam0)
    write_kitti_poses(folder / "poses" / f"{SEQUENCE}.txt", poses)


def _by_frame(write: Callable[[Path, StereoRig], None]) -> Callable[[Path, Drive], None]:
    def shared(folder: Path, drive: Drive) -> None:
        for index in range(len(drive.timestamps_ns)):
            write(folder / "training" / "calib" / f"{index:06d}.txt", drive.rig)

    return shared


_SHARED: dict[KittiLayout, Callable[[Path, Drive], None]] = {
    "raw": _raw,
    "odometry": _odometry,
    "object": _by_frame(write_object_calib),
    # As in stereo 2012, but with the Velodyne's place.
    "stereo": _by_frame(write_odometry_calib),
}
