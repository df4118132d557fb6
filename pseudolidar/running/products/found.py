"""What a frame has become on its way through `obstacles`, and the files of that."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import LabelError
from pseudolidar.formats.obstacle_json import obstacle_fields, obstacle_of
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.obstacles.corridor import Ahead
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import FrameRecord, OutputFile
from pseudolidar.running.sighting import Seen
from pseudolidar.structures.cloud import PointCloud
from pseudolidar.structures.obstacle import Obstacle
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


def found_file(found: Found) -> OutputFile:
    """Everything that was found in a frame, as JSON."""
    time_s = found.frame.timestamp_ns / NS_PER_S
    fields = [
        obstacle_fields(obstacle, frame=found.frame.id, time_s=time_s, number=number)
        for number, obstacle in enumerate(found.obstacles, start=1)
    ]
    return OutputFile.of(found_name(found.frame.id), json.dumps(fields).encode())


def read_found(folder: Path, record: FrameRecord) -> list[dict[str, Any]]:
    """What was found in a frame that is committed.

    Raises:
        LabelError: its file was changed by somebody.
    """
    path = inside(folder, found_name(record.id))
    try:
        fields = json.loads(path.read_bytes())
        obstacles_of(fields, path)
    except (OSError, ValueError) as error:
        raise LabelError(
            f"{type(error).__name__}: {error}", want="what this run wrote", path=path
        ) from error
    return list(fields)


def obstacles_of(fields: Sequence[dict[str, Any]], path: Path) -> tuple[Obstacle, ...]:
    """The obstacles of a frame's file, without their pixels."""
    return tuple(
        obstacle_of(one, where=f"{path}, object {number}") for number, one in enumerate(fields)
    )
