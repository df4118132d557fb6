"""`--to kitti`: stereo clouds as the training tree that OpenPCDet and MMDetection3D read.

kitti/training/{velodyne,calib,image_2,image_3,label_2}/NNNNNN.*     frames with labels
kitti/testing/{velodyne,calib,image_2,image_3}/NNNNNN.*              frames without
kitti/ImageSets/{train,val,trainval,test}.txt
kitti/frames.csv                                        number, id of the source, set
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.labels import encode_labels
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.formats.points.velodyne_bin import encode_velodyne_bin
from pseudolidar.formats.rigs.kitti import encode_object_calib
from pseudolidar.geometry.cloud_frames import left_in
from pseudolidar.geometry.frames import left_in_base_link
from pseudolidar.running.journal.record import FrameRecord, OutputFile
from pseudolidar.structures.arrays import Int64
from pseudolidar.structures.camera import StereoRig
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.frame import StereoFrame
from pseudolidar.structures.pose import Pose

ROOT = "kitti"
IMAGE_SETS = ("train", "val", "trainval", "test")
PRODUCTS = (*(f"{ROOT}/ImageSets/{name}.txt" for name in IMAGE_SETS), f"{ROOT}/frames.csv")
# Pictures without a sequence: neighbours by number are no neighbours in time.
SINGLE_PICTURES = ("kitti-object", "kitti-stereo")
# Pictures farther apart in time than this belong to different drives; a block of one drive that
# goes to one set as a whole is this long, and there are at least so many blocks.
DRIVE_GAP_S, BLOCK_S, LEAST_BLOCKS = 1.0, 10.0, 4
# Training pictures nearer in time to a validation picture are in neither set.
LEAK_S, LEAK_SHARE = 1.0, 0.2
_NUMBER = re.compile(r"[0-9]{6}")
_NS_PER_S = 1e9


@dataclass(frozen=True)
class KittiTree:
    """The training tree of `--to kitti`; `--beams` thins its clouds to a LiDAR's.

    Args:
        images: write both pictures, too; as PNG without loss.
        val_share: share of the labelled pictures for validation.
        seed: decides which.
    """

    images: bool = True
    val_share: float = 0.25
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.val_share < 1:
            raise UsageError(f"val_share {self.val_share}", want="0 to below 1", where="val_share")


def numbers_of(ids: Sequence[str]) -> dict[str, str]:
    """Six digits by id: the ids themselves where all have that form, else positions."""
    if all(_NUMBER.fullmatch(name) for name in ids):
        return {name: name for name in ids}
    return {name: f"{index:06d}" for index, name in enumerate(ids)}


def tree_files(
    frame: StereoFrame, cloud: PointCloud, *, number: str, tree: KittiTree
) -> list[OutputFile]:
    """The files of a frame.

    Args:
        frame: with labels, or for the test set.
        cloud: in `velodyne`, `base_link` or the left camera's frame.
        number: six digits.
        tree: settings.
    """
    rig = with_velodyne(frame.rig)
    points = in_velodyne(cloud, frame.rig, rig)
    half = f"{ROOT}/{'testing' if frame.labels is None else 'training'}"
    contents = {
        f"velodyne/{number}.bin": encode_velodyne_bin(points),
        f"calib/{number}.txt": encode_object_calib(rig),
    }
    if tree.images:
        contents[f"image_2/{number}.png"] = encode_png(frame.left)
        contents[f"image_3/{number}.png"] = encode_png(frame.right)
    if frame.labels is not None:
        contents[f"label_2/{number}.txt"] = encode_labels(frame.labels)
    return [OutputFile.of(f"{half}/{name}", data) for name, data in contents.items()]


def with_velodyne(rig: StereoRig) -> StereoRig:
    """The rig with what the layout must have: a Velodyne and an IMU.

    Where there is none, the Velodyne stands in the left camera, x forward, and the IMU in it: the
    layout has no word for "absent", and its readers count the rows.
    """
    if rig.T_left_velodyne is None:
        turned = replace(left_in_base_link(rig).inverse(), src="velodyne")
        rig = replace(rig, T_left_velodyne=turned)
    if rig.T_velodyne_imu is None:
        rig = replace(rig, T_velodyne_imu=Pose.identity("velodyne", "imu"))
    return rig


def in_velodyne(cloud: PointCloud, rig: StereoRig, tree_rig: StereoRig) -> PointCloud:
    """The cloud in the frame that the tree calls Velodyne."""
    if cloud.frame == "velodyne":
        return cloud
    T_left_cloud = Pose.identity(rig.left.frame, rig.left.frame)
    if cloud.frame != rig.left.frame:
        T_left_cloud = left_in(rig, cloud.frame).inverse()
    T_left_velodyne = tree_rig.T_left_velodyne
    assert T_left_velodyne is not None
    return cloud.transformed(T_left_velodyne.inverse() @ T_left_cloud)


def finish_tree(
    folder: Path,
    records: Sequence[FrameRecord],
    times_ns: Mapping[str, int],
    *,
    kind: str,
    numbers: Mapping[str, str],
    tree: KittiTree,
) -> None:
    """Write the lists of the committed frames.

    Args:
        folder: output folder of the run.
        records: of its frames.
        times_ns: of the source's frames by id.
        kind: of the source.
        numbers: six digits by id.
        tree: settings.
    """
    done = [record.id for record in records if record.skipped is None]
    trained = {
        record.id
        for record in records
        if any(file.name.startswith(f"{ROOT}/training/") for file in record.files)
    }
    labelled = [name for name in done if name in trained]
    stamps = np.array([times_ns[name] for name in labelled], np.int64)
    validation, kept = split(stamps, tree, single=kind in SINGLE_PICTURES)
    val = {name for name, chosen in zip(labelled, validation, strict=True) if chosen}
    train = {name for name, chosen in zip(labelled, kept, strict=True) if chosen} - val
    sets = {
        "train": [name for name in labelled if name in train],
        "val": [name for name in labelled if name in val],
        "trainval": labelled,
        "test": [name for name in done if name not in trained],
    }
    for name, members in sets.items():
        text = "".join(
            numbers[member] + "\n" for member in sorted(members, key=lambda m: numbers[m])
        )
        write_atomic(folder / ROOT / "ImageSets" / f"{name}.txt", text.encode())
    rows = [f"{numbers[name]},{name},{_set_of(name, train, val, trained)}\n" for name in done]
    write_atomic(folder / ROOT / "frames.csv", ("number,source,set\n" + "".join(rows)).encode())


def _set_of(name: str, train: set[str], val: set[str], labelled: set[str]) -> str:
    if name not in labelled:
        return "test"
    return "train" if name in train else "val" if name in val else "between"


def split(times_ns: Int64, tree: KittiTree, *, single: bool) -> tuple[list[bool], list[bool]]:
    """Which pictures validate, and which may train: by blocks of time, so that none leaks.

    Args:
        times_ns: (N,) of the labelled pictures, in order.
        tree: share and seed.
        single: pictures without a sequence; each is a block.
    """
    blocks = np.arange(len(times_ns)) if single else _blocks(times_ns)
    count = int(blocks[-1]) + 1 if len(blocks) else 0
    wanted = round(tree.val_share * len(times_ns))
    validation = np.zeros(len(times_ns), bool)
    for block in np.random.default_rng(tree.seed).permutation(count):
        more = np.count_nonzero(blocks == block)
        # Not more than is wanted; half a block too many is nearer than half too few.
        if np.count_nonzero(validation) + more / 2 <= wanted:
            validation |= blocks == block
    kept = ~validation
    if not single and validation.any():
        seconds = (times_ns - times_ns[0]) / _NS_PER_S
        shortest = min(np.ptp(seconds[blocks == block]) for block in range(count))
        leak_s = min(LEAK_S, LEAK_SHARE * shortest)
        away = np.abs(seconds[:, None] - seconds[validation][None]).min(axis=1)
        kept &= away > leak_s
    return validation.tolist(), kept.tolist()


def _blocks(times_ns: Int64) -> Int64:
    """(N,) number of the block of each picture, from 0 on."""
    if not len(times_ns):
        return np.zeros(0, np.int64)
    seconds = (times_ns - times_ns[0]) / _NS_PER_S
    drive = np.concatenate([[0], np.cumsum(np.diff(seconds) > DRIVE_GAP_S)])
    length_s = BLOCK_S
    if drive[-1] + 1 < LEAST_BLOCKS:
        length_s = min(BLOCK_S, max(seconds[-1], 1e-9) / LEAST_BLOCKS)
    begin = seconds[np.searchsorted(drive, drive)]
    part = np.floor((seconds - begin) / length_s * (1 - 1e-12)).astype(np.int64)
    _names, numbers = np.unique(np.stack([drive, part], axis=1), axis=0, return_inverse=True)
    return np.asarray(numbers, np.int64).reshape(-1)
