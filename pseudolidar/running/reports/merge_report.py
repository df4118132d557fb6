"""What was joined to one cloud: frames, points, and what the common frame is to them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED
from pseudolidar.geometry.cloud_frames import CloudFrame
from pseudolidar.geometry.frames import MAP, ODOM
from pseudolidar.geometry.path_length import length_m
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.one_cloud import skipped_lines
from pseudolidar.structures.arrays import Float64

# A sensor whose places all lie this near to one another stands still.
STILL_M = 0.01
# Frames that do not move with a sensor, by REP-105.
FIXED_FRAMES = (MAP, ODOM, "earth", "world")


@dataclass(frozen=True, eq=False)
class Part:
    """What a frame gives to the joined cloud.

    Args:
        id: the source's name of the frame.
        index: its position in the source.
        timestamp_ns: time of the cloud.
        own_frame: coordinate frame that it was in.
        origin_m: (3,) where that frame's origin is.
        points: how many it has.
        joined: how many of them are handed over.
        replaced: whether it had a column of the name that ours has.
    """

    id: str
    index: int
    timestamp_ns: int
    own_frame: str
    origin_m: Float64
    points: int
    joined: int
    replaced: bool


@dataclass(frozen=True, eq=False)
class MergeReport:
    """What was joined.

    Args:
        out: the file.
        frame: the common frame.
        parts: the frames, without their clouds.
        skipped: frames that were left out, with the reason.
        points: points of the file.
        columns: their columns.
        notes: what was lost.
    """

    out: Path
    frame: CloudFrame
    parts: tuple[Part, ...]
    skipped: tuple[Skipped, ...]
    points: int
    columns: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 all frames are in it, 4 some were skipped."""
        return SOME_SKIPPED if self.skipped else ALL_DONE

    @property
    def path_m(self) -> float:
        """How far the clouds' own frame moves in the common one."""
        places = np.array([part.origin_m for part in self.parts])
        return length_m(places)

    @property
    def poses(self) -> str:
        """What the common frame is to the clouds."""
        own = {part.own_frame for part in self.parts}
        if self.path_m > STILL_M:
            return f"by the poses of the source, which moves {self.path_m:.1f} m"
        if own != {self.frame}:
            return "in which the source stands still, or knows no poses"
        if self.frame in FIXED_FRAMES:
            return "in which the clouds were already"
        return (
            "their own, where clouds of a moving sensor do not lie on one another (recordings have "
            "poses, files of clouds have none)"
        )

    def as_dict(self) -> dict[str, Any]:
        """Counts, the frames in order, and where the file is."""
        return {
            "out": str(self.out),
            "bytes": self.out.stat().st_size,
            "frame": self.frame,
            "poses": self.poses,
            "path_m": round(self.path_m, 4),
            "points": self.points,
            "points_of_source": sum(part.points for part in self.parts),
            "columns": list(self.columns),
            "notes": list(self.notes),
            "merged": [
                {
                    "id": part.id,
                    "frame_index": part.index,
                    "timestamp_ns": part.timestamp_ns,
                    "points_of_source": part.points,
                    "points_joined": part.joined,
                    "origin_m": part.origin_m.round(4).tolist(),
                }
                for part in self.parts
            ],
            "skipped": [{"id": each.id, **each.error.as_dict()} for each in self.skipped],
            "exit_code": self.exit_code,
        }

    def text(self) -> str:
        """The same for people."""
        of, total = sum(part.points for part in self.parts), len(self.parts) + len(self.skipped)
        return "\n".join(
            [
                f"{len(self.parts)} of {total} frames, {self.points} of {of} points",
                *skipped_lines(self.skipped),
                f"  frame {self.frame}, {self.poses}",
                f"  columns {', '.join(self.columns)}",
                *(f"  {note}" for note in self.notes),
                f"  {self.out}",
            ]
        )
