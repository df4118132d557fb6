"""What a frame has become on its way through `obstacles`, and the files of that."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import LabelError
from pseudolidar.evaluation.obstacles import JudgedObject, judged_objects
from pseudolidar.formats.obstacle_json import obstacle_fields, obstacle_of
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.frames import MAP
from pseudolidar.obstacles.corridor_view import CorridorView
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.camera import LEFT_FRAME, Camera
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.pose import Pose
from pseudolidar.structures.recorded import Frame

FOUND_FOLDER = ".obstacles"
OBJECT_COLUMN = "object"


@dataclass(frozen=True, eq=False)
class Found:
    """Obstacles of a frame.

    Args:
        frame: as its source had it.
        seen: depth, ground and cloud.
        obstacles: the nearest first.
        corridor: what is seen of the one that is watched, if one is.
        searched: whether a detector was asked, or the corridor alone watched.
    """

    frame: Frame
    seen: Seen
    obstacles: tuple[Obstacle, ...]
    corridor: CorridorView | None = None
    searched: bool = True

    @property
    def cloud(self) -> PointCloud:
        """The points of the frame, column `object`: 0 for none, else 1 + number of the obstacle."""
        numbers = np.zeros(len(self.seen.cloud), np.int32)
        for number, obstacle in reversed(list(enumerate(self.obstacles, start=1))):
            numbers[obstacle.pixels] = number
        cloud = self.seen.cloud
        cloud = replace(cloud, extra={**cloud.extra, OBJECT_COLUMN: numbers})
        return cloud[cloud.valid]


def found_name(frame_id: str) -> str:
    """Name in the output folder of what was found in a frame."""
    return f"{FOUND_FOLDER}/{frame_id}.json"


@dataclass(frozen=True, eq=False)
class FoundFrame:
    """What the file of a frame holds.

    Args:
        time_ns: of the picture.
        T_map_camera: pose of the left camera, where it is known.
        camera: that the obstacles are seen by.
        obstacles: fields of each, as `obstacle_json` has them.
        judged: the labels of the frame that count, each beside what was measured of it.
    """

    time_ns: int
    T_map_camera: Pose | None
    camera: Camera
    obstacles: list[dict[str, Any]]
    judged: tuple[JudgedObject, ...] = ()

    def parsed(self, where: str) -> tuple[Obstacle, ...]:
        """The obstacles, without their pixels."""
        return tuple(
            obstacle_of(one, where=f"{where}, object {number}")
            for number, one in enumerate(self.obstacles)
        )


def found_file(found: Found) -> OutputFile:
    """Everything that was found in a frame, as JSON."""
    time_ns, T = found.frame.timestamp_ns, found.seen.T_map_camera
    camera = found.seen.sight.camera
    fields = [
        obstacle_fields(obstacle, frame=found.frame.id, time_s=time_ns / NS_PER_S, number=number)
        for number, obstacle in enumerate(found.obstacles, start=1)
    ]
    data = {
        "time_ns": time_ns,
        "T_map_camera": None if T is None else T.matrix.tolist(),
        "camera": {"K": camera.K.tolist(), "size_px": [camera.width_px, camera.height_px]},
        "obstacles": fields,
        "judged": [dict(vars(one)) for one in _judged(found)],
    }
    return OutputFile.of(found_name(found.frame.id), json.dumps(data).encode())


def _judged(found: Found) -> tuple[JudgedObject, ...]:
    """The labels that count, each beside what was measured of it; none where nothing was asked."""
    sight = found.seen.sight
    if sight.labels is None or not found.searched:
        return ()
    return judged_objects(found.frame.id, sight.labels, found.obstacles, sight.camera, sight.depth)


def read_found(folder: Path, frame_id: str) -> FoundFrame:
    """What was found in a frame that is committed.

    Raises:
        LabelError: its file was changed by somebody.
    """
    path = inside(folder, found_name(frame_id))
    try:
        return parse_found(path.read_bytes(), where=str(path))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LabelError(
            f"{type(error).__name__}: {error}", want="what this run wrote", path=path
        ) from error


def parse_found(data: bytes, *, where: str) -> FoundFrame:
    """What the file of a frame holds.

    Raises:
        KeyError, TypeError, ValueError: a field is missing or of another kind.
        LabelError: an obstacle cannot be read.
    """
    fields = json.loads(data)
    pose, (width, height) = fields["T_map_camera"], fields["camera"]["size_px"]
    T = None if pose is None else Pose(MAP, LEFT_FRAME, np.array(pose, np.float64))
    camera = Camera(np.array(fields["camera"]["K"], np.float64), int(width), int(height))
    judged = tuple(JudgedObject(**one) for one in fields.get("judged", ()))
    found = FoundFrame(int(fields["time_ns"]), T, camera, list(fields["obstacles"]), judged)
    found.parsed(where)
    return found
