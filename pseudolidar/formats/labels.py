"""KITTI object labels: `label_2` lines (15 columns, 16 with a score) and tracking lines (17, 18).

A line is: type, truncated, occluded, alpha, box left top right bottom (px, first pixel centre at
0), height width length (m), x y z of the bottom centre in rectified camera 0 (m), rotation_y,
[score]. Unset values are -1, -10 and -1000; they become None, and the label is marked `ignore`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pseudolidar.errors import LabelError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.rigs.kitti_calibration import FRAME_CAM0
from pseudolidar.formats.text import TextLine, Word, read_lines
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.box import Box3D, Detection, Label
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

CLASSES = (
    "Car",
    "Van",
    "Truck",
    "Pedestrian",
    "Person_sitting",
    "Cyclist",
    "Tram",
    "Misc",
    "DontCare",
)
# The tracking data writes the sitting person in another way.
KNOWN_CLASSES = (*CLASSES, "Person")
COLUMNS, TRACKING_COLUMNS = 15, 17
UNSET_SIZE_M, UNSET_LOCATION_M, UNSET_ANGLE_RAD = -1.0, -1000.0, -10.0
UNKNOWN_OCCLUSION = 3
UNSET_TRUNCATION, UNSET_OCCLUSION, UNSET_TRACK = -1, -1, -1


def read_labels(
    path: Path, *, T_left_cam0: Pose, limits: Limits = DEFAULT_LIMITS
) -> tuple[Label, ...]:
    """Read a `label_2` or result file.

    Args:
        path: file of 15 or 16 columns; an empty one has no objects.
        T_left_cam0: where the left camera is (`KittiCalibration.T_left_cam0`); boxes come out in
            `camera_left`.
        limits: cap on its size.

    Raises:
        LabelError: missing file, wrong number of columns, no number, impossible size, by line.
    """
    lines = read_lines(path, error=LabelError, limits=limits)
    return tuple(_label(line, line.words(), T_left_cam0) for line in lines if line.text)


def read_tracking_labels(
    path: Path, *, T_left_cam0: Pose, limits: Limits = DEFAULT_LIMITS
) -> dict[int, tuple[Label, ...]]:
    """Read a tracking file (frame, track, then a label): labels by frame number.

    Raises:
        LabelError: as `read_labels`.
    """
    frames: dict[int, list[Label]] = {}
    for line in read_lines(path, error=LabelError, limits=limits):
        words = line.words()
        if not words:
            continue
        _check_columns(line, words, TRACKING_COLUMNS)
        track = _integer(line, words[1])
        label = _label(line, words[2:], T_left_cam0)
        label = replace(label, track_id=None if track == UNSET_TRACK else track)
        frames.setdefault(_integer(line, words[0]), []).append(label)
    return {frame: tuple(labels) for frame, labels in frames.items()}


def unknown_classes(labels: Iterable[Label]) -> tuple[str, ...]:
    """Classes among `labels` that KITTI does not have."""
    names = {label.detection.name for label in labels}
    return tuple(sorted(names.difference(KNOWN_CLASSES)))


def write_labels(
    path: Path,
    labels: Sequence[Label],
    *,
    T_left_cam0: Pose | None = None,
    decimals: int | None = None,
    scores: bool = False,
) -> None:
    """Write a `label_2` file, or a result file where `scores` are wanted: `encode_labels`."""
    data = encode_labels(labels, T_left_cam0=T_left_cam0, decimals=decimals, scores=scores)
    write_atomic(path, data)


def encode_labels(
    labels: Sequence[Label],
    *,
    T_left_cam0: Pose | None = None,
    decimals: int | None = None,
    scores: bool = False,
) -> bytes:
    """The bytes of a `label_2` file, or of a result file where `scores` are wanted.

    Args:
        labels: with boxes in `camera_left`.
        T_left_cam0: where camera 0 is; by default it is the left camera.
        decimals: digits behind the point (KITTI: 2); all there are by default.
        scores: add the score column.
    """
    T_cam0_left = (T_left_cam0 or Pose.identity("camera_left", FRAME_CAM0)).inverse()
    lines = [_line(label, T_cam0_left, decimals, scores) + "\n" for label in labels]
    return "".join(lines).encode()


def encode_tracking_labels(
    frames: Mapping[int, Sequence[Label]],
    *,
    T_left_cam0: Pose | None = None,
    decimals: int | None = None,
    scores: bool = False,
) -> bytes:
    """The bytes of a tracking file: `encode_labels` with frame and track before each line.

    Args:
        frames: labels by frame number; those without a track get -1.
        T_left_cam0: where camera 0 is; by default it is the left camera.
        decimals: digits behind the point; all there are by default.
        scores: add the score column, as in files of results.
    """
    T_cam0_left = (T_left_cam0 or Pose.identity("camera_left", FRAME_CAM0)).inverse()
    lines = [
        f"{number} {UNSET_TRACK if label.track_id is None else label.track_id} "
        f"{_line(label, T_cam0_left, decimals, scores)}\n"
        for number, labels in sorted(frames.items())
        for label in labels
    ]
    return "".join(lines).encode()


def result_label(obstacle: Obstacle) -> Label:
    """An obstacle as KITTI's results have it: nothing is said of truncation and occlusion.

    But of one that coasts, whose occlusion is 3, unknown. The score is that of the detector. A name
    of several words becomes one: `traffic_light`.
    """
    name = "_".join(obstacle.detection.name.split()) or "object"
    track = obstacle.track
    return Label(
        replace(obstacle.detection, name=name, mask=None),
        obstacle.box,
        occlusion=UNKNOWN_OCCLUSION if obstacle.coasts else None,
        track_id=None if track is None else track.track_id,
    )


# --- reading -------------------------------------------------------------------------------------


def _label(line: TextLine, words: list[Word], T_left_cam0: Pose) -> Label:
    _check_columns(line, words, COLUMNS)
    v = line.numbers(words[1:])
    detection = _detection(line, words[0].text, v)
    box = _box(line, v, T_left_cam0)
    return Label(
        detection=detection,
        box=box,
        truncation=None if v[0] == UNSET_TRUNCATION else v[0],
        occlusion=None if v[1] == UNSET_OCCLUSION else _integer(line, words[2]),
        ignore=detection.name == "DontCare" or box is None,
        alpha_rad=None if v[2] == UNSET_ANGLE_RAD else v[2],
    )


def _check_columns(line: TextLine, words: list[Word], columns: int) -> None:
    if len(words) not in (columns, columns + 1):
        other = TRACKING_COLUMNS if columns == COLUMNS else COLUMNS
        looks_other = len(words) in (other, other + 1)
        kind = "a tracking" if other == TRACKING_COLUMNS else "an object"
        raise line.refusal(
            f"{len(words)} columns",
            want=f"{columns}, or {columns + 1} with a score",
            fix=f"It looks like {kind} label file." if looks_other else "",
        )


def _integer(line: TextLine, word: Word) -> int:
    value = line.number_of(word)
    if value != int(value):
        raise line.refusal(f"{word.text!r}", want="a whole number", column=word.column)
    return int(value)


def _detection(line: TextLine, name: str, v: list[float]) -> Detection:
    left, top, right, bottom = v[3:7]
    if not (left <= right and top <= bottom):
        raise line.refusal(
            f"image box {left:g} {top:g} {right:g} {bottom:g}", want="left <= right, top <= bottom"
        )
    score = v[14] if len(v) == COLUMNS else 1.0
    return Detection(name, (left, top, right, bottom), score)


def _box(line: TextLine, v: list[float], T_left_cam0: Pose) -> Box3D | None:
    height_m, width_m, length_m = v[7:10]
    sizes = (height_m, width_m, length_m)
    if all(size == UNSET_SIZE_M for size in sizes) or UNSET_LOCATION_M in v[10:13]:
        return None
    if min(sizes) <= 0:
        raise line.refusal(
            f"size {height_m:g} {width_m:g} {length_m:g} m", want="above 0, or -1 -1 -1 for unset"
        )
    centre_m = np.array([v[10], v[11] - height_m / 2.0, v[12]])
    T_cam0_box = Pose.from_rotation(FRAME_CAM0, "box", _rotation(v[13]), centre_m)
    return Box3D(T_left_cam0 @ T_cam0_box, length_m, width_m, height_m)


def _rotation(rotation_y_rad: float) -> Float64:
    """(3, 3): columns are the box's forward, left and up axes in camera axes.

    At rotation_y 0 the object faces along camera x; a positive angle turns it towards -z.
    """
    c, s = math.cos(rotation_y_rad), math.sin(rotation_y_rad)
    return np.array([[c, s, 0.0], [0.0, 0.0, -1.0], [-s, c, 0.0]])


# --- writing -------------------------------------------------------------------------------------


def _line(label: Label, T_cam0_left: Pose, decimals: int | None, scores: bool) -> str:
    def number(value: float) -> str:
        return repr(float(value)) if decimals is None else f"{value:.{decimals}f}"

    words = [label.detection.name, _optional(label.truncation, UNSET_TRUNCATION, number)]
    words.append(str(UNSET_OCCLUSION if label.occlusion is None else label.occlusion))
    if label.box is None:
        words += [_optional(label.alpha_rad, UNSET_ANGLE_RAD, number)]
        words += map(number, label.detection.box_px)
        words += [*["-1"] * 3, *["-1000"] * 3, "-10"]
    else:
        T_cam0_box = T_cam0_left @ label.box.pose
        rotation_y, location = _rotation_y(T_cam0_box), T_cam0_box.translation_m
        location[1] += label.box.height_m / 2.0
        alpha = label.alpha_rad
        if alpha is None:
            alpha = _wrapped(rotation_y - math.atan2(location[0], location[2]))
        words += map(number, (alpha, *label.detection.box_px))
        words += map(number, (label.box.height_m, label.box.width_m, label.box.length_m))
        words += map(number, (*location, rotation_y))
    return " ".join([*words, number(label.detection.score)] if scores else words)


def _optional(value: float | None, unset: float, number: Callable[[float], str]) -> str:
    return f"{unset:g}" if value is None else number(value)


def _rotation_y(T_cam0_box: Pose) -> float:
    forward = T_cam0_box.matrix[:3, 0]
    return math.atan2(-forward[2], forward[0])


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)
