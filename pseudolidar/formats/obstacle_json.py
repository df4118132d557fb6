"""Obstacles as plain JSON values, one object each, and back without loss.

Fields: `frame`, `time_s`, `number` (in the frame), `class`, `score`, `box_px` (left, top, right,
bottom; first pixel centre at 0), `distance_m` (Z of the nearest face), `sigma_distance_m`,
`centre_m` (x right, y down, z ahead of the left camera), `size_m` (length, width, height),
`heading_rad` (of the length, about the vertical, 0 ahead, to the right positive; which end is the
front nobody knows), `sigma_*` one standard deviation each (of the centre along the box's axes;
`sigma_shared_m` that part of the distance's which is the same in every frame),
`rotation` (3 rows, box to camera), `points`, `confidence`, `truncated`, `occluded`, `measured_by`,
`bound` (it may be nearer).
Of a tracked one also what `track_json` has. `obstacle.schema.json` beside this file is the form of
an object; `obstacles.jsonl` has one on each line.
"""

from __future__ import annotations

import importlib.resources
import json
import math
from pathlib import Path
from typing import Any, cast

import numpy as np

from pseudolidar.errors import LabelError, PseudolidarError
from pseudolidar.formats.limits import DEFAULT_LIMITS, Limits
from pseudolidar.formats.text import read_lines
from pseudolidar.formats.track_json import track_fields, track_of
from pseudolidar.structures.box import Box3D, Detection
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose

CAMERA, BOX = "camera_left", "box"


def obstacle_fields(
    obstacle: Obstacle, *, frame: str, time_s: float, number: int
) -> dict[str, Any]:
    """All that is known of an obstacle but its pixels, as plain JSON values."""
    box = obstacle.box
    sigma = [] if box.sigma_m is None else box.sigma_m.tolist()
    return {
        "frame": frame,
        "time_s": time_s,
        "number": number,
        "class": obstacle.detection.name,
        "score": obstacle.detection.score,
        "box_px": list(obstacle.detection.box_px),
        "distance_m": obstacle.distance_m,
        "sigma_distance_m": obstacle.sigma_distance_m,
        "centre_m": box.pose.translation_m.tolist(),
        "sigma_centre_m": sigma[:3],
        "size_m": [box.length_m, box.width_m, box.height_m],
        "sigma_size_m": sigma[3:],
        "heading_rad": heading_rad(box),
        "sigma_heading_rad": obstacle.sigma_heading_rad,
        "rotation": box.pose.matrix[:3, :3].tolist(),
        "points": obstacle.points,
        "confidence": obstacle.confidence,
        "truncated": obstacle.truncated,
        "occluded": obstacle.occluded,
        "sigma_shared_m": obstacle.sigma_shared_m,
        "measured_by": obstacle.measured_by,
        "bound": obstacle.bound,
        **({} if obstacle.track is None else track_fields(obstacle.track)),
    }


def obstacle_of(fields: dict[str, Any], *, where: str) -> Obstacle:
    """The obstacle again, without its pixels.

    Args:
        fields: as `obstacle_fields` made them.
        where: file and line, for the error.

    Raises:
        LabelError: a field is missing, of another kind, or impossible.
    """
    try:
        pose = Pose.from_rotation(
            CAMERA, BOX, np.array(fields["rotation"], float), np.array(fields["centre_m"], float)
        )
        sigma = np.array([*fields["sigma_centre_m"], *fields["sigma_size_m"]], float)
        left, top, right, bottom = (float(value) for value in fields["box_px"])
        length_m, width_m, height_m = (float(value) for value in fields["size_m"])
        return Obstacle(
            Detection(str(fields["class"]), (left, top, right, bottom), float(fields["score"])),
            float(fields["distance_m"]),
            float(fields["sigma_distance_m"]),
            Box3D(pose, length_m, width_m, height_m, sigma),
            float(fields["sigma_heading_rad"]),
            fields["measured_by"],
            float(fields["confidence"]),
            bool(fields["truncated"]),
            bool(fields["occluded"]),
            float(fields.get("sigma_shared_m", 0.0)),
            bool(fields.get("bound", False)),
            track=track_of(fields),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise LabelError(
            f"an obstacle that cannot be read ({type(error).__name__}: {error})",
            want="the fields that `pseudolidar obstacles` writes",
            where=where,
        ) from error


def read_obstacles(
    path: Path, *, limits: Limits = DEFAULT_LIMITS
) -> dict[str, tuple[Obstacle, ...]]:
    """The obstacles of an `obstacles.jsonl` by the id of their frame, in the order of the file.

    Args:
        path: the file; one without lines has no obstacles.
        limits: cap on its size.

    Raises:
        LabelError: missing file, a line that is no JSON object, a field that is missing, of another
            kind or impossible; by line.
    """
    found: dict[str, list[Obstacle]] = {}
    for number, line in enumerate(read_lines(path, error=LabelError, limits=limits), start=1):
        if not line.text.strip():
            continue
        where = f"line {number}"
        try:
            fields = json.loads(line.text)
        except (ValueError, RecursionError) as error:
            raise LabelError("no JSON", want="an object", path=path, where=where) from error
        if not isinstance(fields, dict) or not isinstance(fields.get("frame"), str):
            raise LabelError("no object with a frame", want="an obstacle", path=path, where=where)
        try:
            found.setdefault(fields["frame"], []).append(obstacle_of(fields, where=where))
        except PseudolidarError as error:
            raise LabelError(error.got, want=error.want, path=path, where=where) from error
    return {frame: tuple(obstacles) for frame, obstacles in found.items()}


def obstacle_schema() -> dict[str, Any]:
    """The JSON Schema of one obstacle."""
    file = importlib.resources.files(__package__) / "obstacle.schema.json"
    return cast("dict[str, Any]", json.loads(file.read_text("utf-8")))


def heading_rad(box: Box3D) -> float:
    """Direction of the length in the camera's horizontal plane: 0 ahead, to the right positive."""
    forward = box.pose.matrix[:3, 0]
    return math.atan2(forward[0], forward[2])
