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
    CalibrationSyntax,
    LabelError,
    PointFileCorrupt,
    SequenceTime,
)
from pseudolidar.evaluation.map_files import read_map
from pseudolidar.evaluation.trajectory.motions import angles_rad, motions, path_lengths
from pseudolidar.formats.labels import read_labels
from pseudolidar.formats.onnx.model import read_onnx
from pseudolidar.formats.oxts import read_oxts
from pseudolidar.formats.pictures.image import read_header
from pseudolidar.formats.pictures.image_kinds import EXTENSIONS, SNIFFED_BYTES, content_kind
from pseudolidar.formats.points.npz import npz_arrays
from pseudolidar.formats.rigs.body_json import MARK, has_pairs, read_body
from pseudolidar.formats.rigs.key_values import read_key_values
from pseudolidar.formats.rigs.rig_file import read_any_rig
from pseudolidar.formats.text import NUMBER, read_lines
from pseudolidar.formats.timestamps import NS_PER_S, read_times, read_timestamps
from pseudolidar.formats.trajectory_file import POSE_SUFFIXES, read_trajectory
from pseudolidar.running.describing.column_figures import ColumnFigures
from pseudolidar.running.describing.describe_source import rig_facts, time_facts
from pseudolidar.structures.arrays import Float64, Int64
from pseudolidar.structures.body import MountedPair
from pseudolidar.structures.pose import Pose, rotation_error

Found = tuple[str, dict[str, Any], tuple[str, ...]]
# Holds any principal point; such a size is never told.
_ANY_SIZE_PX = (100_000, 100_000)
_RIG_SUFFIXES = {".json", ".yaml", ".yml", ".xml", ".txt"}
_PICTURES = set().union(*EXTENSIONS.values())
ROTATION_TOLERANCE = 1e-3


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


def _body(path: Path) -> Found:
    """Every pair of a body: its rig, and where it stands."""
    body = read_body(path)
    rigs = [
        {"name": pair.name}
        | rig_facts(pair.rig)
        | {"T_base_link_left": pair.T_base_link_left.matrix.tolist()}
        for pair in body.pairs
    ]
    form = f"a rig file of {len(rigs)} stereo pairs on one body ({', '.join(body.names)})"
    notes = (f"of one alone: {path}{MARK}{body.names[0]}",)
    facts = {"origin": body.origin, "entries": [_mount(pair) for pair in body.pairs], "pairs": rigs}
    return form, facts, notes


def _mount(pair: MountedPair) -> dict[str, Any]:
    """One line: what its left camera is, where it stands, and which way it looks."""
    forward, left, up = pair.T_base_link_left.translation_m
    ahead = pair.T_base_link_left.matrix[:3, 2]
    return {
        "pair": pair.name,
        "width_px": pair.rig.left.width_px,
        "height_px": pair.rig.left.height_px,
        "f_px": pair.rig.left.focal_px,
        "baseline_m": pair.rig.baseline_m,
        "forward_m": float(forward),
        "left_m": float(left),
        "up_m": float(up),
        "looks_left_deg": float(np.degrees(np.arctan2(ahead[1], ahead[0]))),
        "looks_up_deg": float(np.degrees(np.arcsin(np.clip(ahead[2], -1, 1)))),
    }


def _rig(path: Path) -> Found:
    if has_pairs(path):
        return _body(path)
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


def _transform(path: Path) -> Found:
    """`calib_velo_to_cam.txt` and the like: where one sensor is for another."""
    fields = read_key_values(path, {"R": 9, "T": 3})
    R, t_m = fields.require("R").reshape(3, 3), fields.require("T")
    if rotation_error(R) > ROTATION_TOLERANCE:
        raise CalibrationField("an R that is no rotation", want="R (9) and T (3)", path=path)
    angle = np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))
    facts: dict[str, Any] = {
        "translation_m": [float(value) for value in t_m],
        "distance_m": float(np.linalg.norm(t_m)),
        "rotation_deg": float(np.degrees(angle)),
    }
    return "where one sensor is for another (KITTI raw: R and T)", facts, ()


def _oxts(path: Path) -> Found:
    packet = read_oxts(path)
    facts = {name: getattr(packet, name) for name in ("latitude_deg", "longitude_deg")}
    facts |= {"altitude_m": packet.altitude_m, "yaw_deg": float(np.degrees(packet.yaw_rad))}
    return "where the IMU was at one moment (KITTI raw: OXTS)", facts, ()


def _arrays(path: Path) -> Found:
    arrays = npz_arrays(path)
    if not arrays:
        raise PointFileCorrupt("no array", want="arrays of NumPy", path=path)
    rows = [
        {"name": name, "dtype": dtype, "shape": "x".join(map(str, shape)) or "one value"}
        for name, (dtype, shape) in arrays.items()
    ]
    return "arrays of NumPy", {"columns": rows}, ()


def _table(path: Path) -> Found:
    """Rows of as many numbers each, whatever they mean."""
    rows, width = 0, 0
    for line in read_lines(path, error=CalibrationSyntax):
        words = line.text.split()
        if not words:
            continue
        if (rows and len(words) != width) or not all(map(NUMBER.fullmatch, words)):
            raise line.refusal(f"{len(words)} words", want=f"{width or 'some'} numbers")
        rows, width = rows + 1, len(words)
    if not rows:
        raise CalibrationSyntax("nothing in the file", want="rows of numbers", path=path)
    facts = {"rows": rows, "values_a_row": width}
    return f"a table of numbers: {rows} rows of {width}; its meaning is not known", facts, ()


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
    found = read_trajectory(path)
    poses = found.T_world_body
    steps_m = np.diff(path_lengths(poses))
    facts: dict[str, Any] = {
        "poses": len(poses),
        "path_m": float(steps_m.sum()),
        "start_to_end_m": float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3])),
        "largest_step_m": float(steps_m.max()) if len(steps_m) else 0.0,
        "largest_turn_deg": _largest_turn_deg(poses),
        "bounding_box_m": _extent(poses),
    }
    if found.times_ns is not None:
        times_ns = found.times_ns.tolist()
        facts["times"] = time_facts(times_ns, [str(i) for i in range(len(times_ns))])
        facts |= _speeds(steps_m, found.times_ns)
    return f"a trajectory of {len(poses)} poses ({found.form})", facts, found.notes


def _largest_turn_deg(poses: Float64) -> float:
    """Of one pose to the next."""
    turns = angles_rad(motions(poses[:-1], poses[1:]))
    return float(np.degrees(turns.max())) if len(turns) else 0.0


def _speeds(steps_m: Float64, times_ns: Int64) -> dict[str, float]:
    if not len(steps_m):
        return {}
    steps_s = np.diff(times_ns) / NS_PER_S
    return {
        "mean_speed_m_s": float(steps_m.sum() / steps_s.sum()),
        "largest_speed_m_s": float((steps_m / steps_s).max()),
    }


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
    FileKind("trajectory", _has(*POSE_SUFFIXES), _trajectory),
    FileKind("labels", _has(".txt"), _labels),
    FileKind("times", _has(".txt"), _times),
    FileKind("calibration", _has(*_RIG_SUFFIXES), _rig),
    FileKind("transform", _has(".txt"), _transform),
    FileKind("imu", _has(".txt"), _oxts),
    FileKind("arrays", _has(".npz"), _arrays),
)
# What any text may be: what is wrong with one that is not tells nothing.
TABLE = FileKind("table", _has(".txt", ".csv"), _table)
