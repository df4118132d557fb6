"""What a frame has become on its way through `obstacles`, and the files of that."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import LabelError
from pseudolidar.formats.obstacle_json import obstacle_fields, obstacle_of
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.formats.track_json import track_fields
from pseudolidar.geometry.frames import MAP
from pseudolidar.obstacles.corridor import Ahead
from pseudolidar.obstacles.tracker import Tracker
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import FrameRecord, OutputFile
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.camera import LEFT_FRAME
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
        ahead: the nearest thing in the corridor that is watched, if one is.
    """

    frame: Frame
    seen: Seen
    obstacles: tuple[Obstacle, ...]
    ahead: Ahead | None = None

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
        obstacles: fields of each, as `obstacle_json` has them.
    """

    time_ns: int
    T_map_camera: Pose | None
    obstacles: list[dict[str, Any]]

    def parsed(self, where: str) -> tuple[Obstacle, ...]:
        """The obstacles, without their pixels."""
        return tuple(
            obstacle_of(one, where=f"{where}, object {number}")
            for number, one in enumerate(self.obstacles)
        )


def found_file(found: Found) -> OutputFile:
    """Everything that was found in a frame, as JSON."""
    time_ns, T = found.frame.timestamp_ns, found.seen.T_map_camera
    fields = [
        obstacle_fields(obstacle, frame=found.frame.id, time_s=time_ns / NS_PER_S, number=number)
        for number, obstacle in enumerate(found.obstacles, start=1)
    ]
    pose = None if T is None else T.matrix.tolist()
    data = {"time_ns": time_ns, "T_map_camera": pose, "obstacles": fields}
    return OutputFile.of(found_name(found.frame.id), json.dumps(data).encode())


def read_found(folder: Path, record: FrameRecord) -> FoundFrame:
    """What was found in a frame that is committed.

    Raises:
        LabelError: its file was changed by somebody.
    """
    path = inside(folder, found_name(record.id))
    try:
        data = json.loads(path.read_bytes())
        pose = data["T_map_camera"]
        T = None if pose is None else Pose(MAP, LEFT_FRAME, np.array(pose, np.float64))
        found = FoundFrame(int(data["time_ns"]), T, list(data["obstacles"]))
        found.parsed(str(path))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LabelError(
            f"{type(error).__name__}: {error}", want="what this run wrote", path=path
        ) from error
    return found


@dataclass(frozen=True, eq=False)
class ToldFrame:
    """A frame's obstacles as they are told at the end, with their tracks where they have any.

    Args:
        fields: of each, for tables.
        obstacles: the same, without their pixels.
    """

    fields: list[dict[str, Any]]
    obstacles: tuple[Obstacle, ...]


def told_frames(
    folder: Path, records: Iterable[FrameRecord], tracker: Tracker | None
) -> dict[str, ToldFrame]:
    """Of every frame that is committed, in the order of the source, by its id.

    Raises:
        LabelError: a file was changed by somebody.
        SequenceTime: tracks are asked for, and a frame is not later than the one before.
    """
    follow = None if tracker is None else tracker.load()
    told = {}
    for record in records:
        if record.skipped is not None:
            continue
        frame = read_found(folder, record)
        obstacles = frame.parsed(record.id)
        if follow is not None:
            obstacles = follow(obstacles, frame.time_ns, frame.T_map_camera).obstacles
        fields = [
            {**one, **({} if obstacle.track is None else track_fields(obstacle.track))}
            for one, obstacle in zip(frame.obstacles, obstacles, strict=True)
        ]
        told[record.id] = ToldFrame(fields, obstacles)
    return told
