"""Single files that are no source: pictures, maps, calibrations, trajectories, networks, labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import (
    CalibrationField,
    LabelError,
    PoseFileError,
    SequenceTime,
)
from pseudolidar.evaluation.map_files import read_map
from pseudolidar.formats.labels import read_labels
from pseudolidar.formats.onnx_model import read_onnx
from pseudolidar.formats.pictures.image import read_header
from pseudolidar.formats.pictures.image_kinds import EXTENSIONS, SNIFFED_BYTES, content_kind
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.timestamps import read_times, read_timestamps
from pseudolidar.formats.trajectory import read_kitti_poses
from pseudolidar.formats.tum import read_tum_trajectory
from pseudolidar.running.describing.column_figures import ColumnFigures
from pseudolidar.running.describing.describe_source import rig_facts, time_facts
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.pose import Pose

Found = tuple[str, dict[str, Any], tuple[str, ...]]
# Holds any principal point; such a size is never told.
_ANY_SIZE_PX = (100_000, 100_000)
_RIG_SUFFIXES = {".json", ".yaml", ".yml", ".xml", ".txt"}
_PICTURES = set().union(*EXTENSIONS.values())
# KITTI's poses are 12 numbers a line, TUM's 8.
_POSE_SUFFIXES = {".txt", ".csv", ".tum"}


@dataclass(frozen=True)
class FileKind:
    """A kind of file.

    Args:
        name: one word.
        looks_like: whether a file may be one, by its name or first bytes.
        describe: what it is, facts and notes.
        values: facts that take reading all of it.
    """

    name: str
    looks_like: Callable[[Path], bool]
    describe: Callable[[Path], Found]
    values: Callable[[Path], dict[str, Any]] = lambda _: {}


def _picture(path: Path) -> Found:
    header = read_header(path)
    size = {"width_px": header.width_px, "height_px": header.height_px}
    facts: dict[str, Any] = {**size, "channels": header.channels, "bits": header.bits}
    colour = "grey" if header.is_grey else "colour"
    what = f"a picture, {header.width_px}x{header.height_px} px, {header.bits} bits, {colour}"
    if header.is_grey and header.bits == 16:
        what += "; of this kind are disparity and depth maps"
    return what, facts, header.notes


def _map_figures(path: Path) -> dict[str, Any]:
    """A 16-bit map as KITTI scales it, and as other programs do: which it is nothing says."""
    header = read_header(path)
    if not header.is_grey or header.bits != 16:
        return {}
    values = read_map(path).values
    known = values[np.isfinite(values)]
    if not known.size:
        return {"figures": {"density": 0.0}}
    least, largest = float(known.min()), float(known.max())
    figures = {
        "density": known.size / values.size,
        "if_kitti_disparity_px": [least, largest],
        "if_kitti_depth_m": [least, largest],
        "if_depth_in_mm_m": [least * 256 / 1000, largest * 256 / 1000],
    }
    return {"figures": figures}


def _map(path: Path) -> Found:
    values = read_map(path).values
    height, width = values.shape
    column = ColumnFigures.of(values.ravel()).as_dict()
    facts: dict[str, Any] = {
        "width_px": width,
        "height_px": height,
        "figures": {"density": 1 - column["nan_share"], "value": [column["min"], column["max"]]},
    }
    return f"a map of disparities or depths, {width}x{height} px", facts, ()


def _rig(path: Path) -> Found:
    notes: tuple[str, ...] = ()
    try:
        reading = read_any_rig(path)
    except CalibrationField as error:
        if "image" not in f"{error.got} {error.want}":
            raise
        # Some formats hold no image size: what else they say is told without it.
        reading = read_any_rig(path, size_px=_ANY_SIZE_PX)
        notes = ("the file holds no image size",)
    rig = reading.rectified or reading.raw
    assert rig is not None
    facts = rig_facts(rig) | (dict.fromkeys(("width_px", "height_px")) if notes else {})
    form = f"a calibration of two cameras ({reading.form})"
    return form, {"rig": facts}, (*notes, *reading.notes)


def _times(path: Path) -> Found:
    try:
        stamps: Sequence[int] = read_times(path)
    except SequenceTime:
        stamps = [stamp for stamp in read_timestamps(path) if stamp is not None]
    if not stamps:
        raise SequenceTime("no time", want="a time on each line", path=path)
    names = [f"line {i + 1}" for i in range(len(stamps))]
    return f"{len(stamps)} times", {"times": time_facts(stamps, names)}, ()


def _labels(path: Path) -> Found:
    labels = read_labels(path, T_left_cam0=Pose("camera_left", "camera_0", np.eye(4)))
    counts = Counter(label.detection.name for label in labels)
    if not counts:
        raise LabelError("no label", want="a label on each line", path=path)
    what = f"{len(labels)} labels of one frame (KITTI)"
    return what, {"objects": dict(counts.most_common())}, ()


def _trajectory(path: Path) -> Found:
    try:
        times, poses = read_tum_trajectory(path)
    except PoseFileError as tum:
        try:
            times, poses = (), read_kitti_poses(path)
        except PoseFileError:
            raise tum from None
    if not len(poses):
        raise PoseFileError("no pose", want="a line for each pose", path=path)
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    facts: dict[str, Any] = {
        "poses": len(poses),
        "path_m": float(steps.sum()),
        "largest_step_m": float(steps.max()) if len(steps) else 0.0,
        "bounding_box_m": _extent(poses),
    }
    if times:
        facts["times"] = time_facts(times, [str(i) for i in range(len(times))])
    form = "TUM" if times else "KITTI"
    return f"a trajectory of {len(poses)} poses ({form})", facts, ()


def _extent(poses: Float64) -> dict[str, list[float]]:
    low, high = poses[:, :3, 3].min(axis=0), poses[:, :3, 3].max(axis=0)
    return {axis: [float(low[i]), float(high[i])] for i, axis in enumerate("xyz")}


def _network(path: Path) -> Found:
    model = read_onnx(path)
    facts: dict[str, Any] = {
        "inputs": [str(info) for info in model.inputs],
        "outputs": [str(info) for info in model.outputs],
        "metadata": dict(model.metadata),
        "external_files": [str(file) for file in model.external],
    }
    return "a network (ONNX)", facts, ()


def _hashed(path: Path) -> dict[str, Any]:
    return {"sha256": read_onnx(path).sha256()}


def _has(*suffixes: str) -> Callable[[Path], bool]:
    return lambda path: path.suffix.lower() in suffixes


def _is_picture(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return content_kind(file.read(SNIFFED_BYTES)) in _PICTURES
    except OSError:
        return False


FILES = (
    FileKind("network", _has(".onnx"), _network, _hashed),
    FileKind("picture", _is_picture, _picture, _map_figures),
    FileKind("map", _has(".pfm", ".npy"), _map),
    FileKind("trajectory", _has(*_POSE_SUFFIXES), _trajectory),
    FileKind("labels", _has(".txt"), _labels),
    FileKind("times", _has(".txt"), _times),
    FileKind("calibration", _has(*_RIG_SUFFIXES), _rig),
)
