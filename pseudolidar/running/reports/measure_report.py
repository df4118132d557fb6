"""What `measure` answers: each box with its distance and size, and what to be careful about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pseudolidar.errors import ALL_DONE, SOME_SKIPPED, printable
from pseudolidar.formats.obstacle_json import obstacle_fields
from pseudolidar.formats.timestamps import NS_PER_S
from pseudolidar.geometry.box_in_view import across_m
from pseudolidar.obstacles.class_sizes import UNKNOWN, size_of_class
from pseudolidar.obstacles.measure import DRAWN_PX
from pseudolidar.running.crew.attempt import Skipped
from pseudolidar.running.table import table_text
from pseudolidar.structures.obstacle import Obstacle
from pseudolidar.structures.recorded import Frame

FEW_POINTS = 20
# A confidence below this is worth a line.
UNSURE = 0.3


@dataclass(frozen=True, eq=False)
class Measured:
    """One thing in one frame.

    Args:
        frame: which.
        obstacle: what was measured.
        focal_px: of the left camera.
    """

    frame: Frame
    obstacle: Obstacle
    focal_px: float


@dataclass(frozen=True, eq=False)
class MeasureReport:
    """What was measured.

    Args:
        found: each box of each frame.
        skipped: frames that could not be measured in.
    """

    found: Sequence[Measured]
    skipped: Sequence[Skipped] = ()

    @property
    def exit_code(self) -> int:
        """0 each box was measured, however unsure; 4 one was not, or a frame was skipped."""
        guessed = any(_is_guess(one.obstacle) for one in self.found)
        return SOME_SKIPPED if guessed or self.skipped else ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """All that is known of each, as in obstacles.jsonl."""
        return {
            "measured": [
                {
                    **obstacle_fields(
                        one.obstacle,
                        frame=one.frame.id,
                        time_s=one.frame.timestamp_ns / NS_PER_S,
                        number=number,
                    ),
                    "across_m": across_m(one.obstacle.box),
                    "sigma_across_m": _sigma_across_m(one),
                }
                for number, one in enumerate(self.found, start=1)
            ],
            "skipped": [{"frame": one.id, **one.error.as_dict()} for one in self.skipped],
        }

    def text(self) -> str:
        """A table, and what to be careful about."""
        rows = [_row(one) for one in self.found]
        header = ("frame", "what", "distance", "across", "height", "right, down, ahead", "points")
        lines = [table_text(rows, header=header)]
        for one in self.found:
            name = printable(one.obstacle.detection.name)
            lines += [f"{name}: {note}" for note in _notes(one.obstacle)]
        lines += [printable(f"skipped {one.id}: {one.error}") for one in self.skipped]
        return "\n".join(lines)


def _is_guess(obstacle: Obstacle) -> bool:
    return obstacle.measured_by == "size"


def _row(one: Measured) -> tuple[str, ...]:
    obstacle, box = one.obstacle, one.obstacle.box
    assert box.sigma_m is not None  # an Obstacle has it
    if _is_guess(obstacle):  # its numbers would read as a measurement; --json has them
        return (one.frame.id, obstacle.detection.name, *["-"] * 4, f"{obstacle.points}")
    x, y, z = box.pose.translation_m
    return (
        one.frame.id,
        obstacle.detection.name,
        f"{obstacle.distance_m:.2f} +- {obstacle.sigma_distance_m:.2f} m",
        f"{across_m(box):.2f} +- {_sigma_across_m(one):.2f} m",
        f"{box.height_m:.2f} +- {box.sigma_m[5]:.2f} m",
        f"{x:.2f}, {y:.2f}, {z:.2f} m",
        f"{obstacle.points}",
    )


def _sigma_across_m(one: Measured) -> float:
    """Both edges of the box in the picture, and the distance that they are seen at."""
    obstacle = one.obstacle
    edges_m = np.sqrt(2.0) * DRAWN_PX * obstacle.distance_m / one.focal_px
    share = obstacle.sigma_distance_m / obstacle.distance_m
    return float(np.hypot(edges_m, share * across_m(obstacle.box)))


def _notes(obstacle: Obstacle) -> list[str]:
    usual = size_of_class(obstacle.detection.name) is not UNKNOWN
    if _is_guess(obstacle):
        said = "nothing in it was matched (sky, no texture, or too small), so it is not measured: "
        if usual:
            return [f"{said}where its usual size and its footing put it is in --json"]
        return [f"{said}where a thing of any size might be is in --json; --name helps"]
    notes = []
    if obstacle.measured_by == "points" and obstacle.points < FEW_POINTS:
        notes.append(f"only {obstacle.points} points")
    if obstacle.confidence < UNSURE:
        notes.append(
            f"confidence {obstacle.confidence:.2f}: little of it can be matched or fits; the "
            "distance may be that of what is beside it"
        )
    if obstacle.truncated:
        size = "that of its class" if usual else "a guess"
        notes.append(f"cut by the border of the picture: its size is {size}")
    if obstacle.bound:
        notes.append("it stands where the search ends and may be nearer: lower --min-depth")
    if obstacle.occluded:
        notes.append("something nearer hides part of it")
    return notes
