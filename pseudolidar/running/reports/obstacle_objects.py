"""Each labelled object beside what was measured of it: for the terminal, and for a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from pseudolidar.evaluation.obstacles import JudgedObject
from pseudolidar.evaluation.page import Picture, PictureRow, Section
from pseudolidar.evaluation.preview_picture import Panel, resized
from pseudolidar.formats.obstacle_words import distance_text, name_text, speed_text
from pseudolidar.running.products.obstacle_film import read_picture
from pseudolidar.running.table import table_text
from pseudolidar.structures.arrays import UInt8
from pseudolidar.structures.obstacle import Obstacle

OBJECT_HEADER = (
    "frame", "object", "label z", "nearest face", "ours", "+-", "off", "usual script", "off z",
)  # fmt: skip
NONE = "-"
# The pictures of a page are so wide, px, and there are at most so many, two a row.
PICTURE_PX, MOST_PICTURES = 900, 6
# Rows of a page: the nearest of each frame first.
MOST_ROWS = 200


def object_rows(objects: Sequence[JudgedObject]) -> list[tuple[str, ...]]:
    """A row of `OBJECT_HEADER` each, in metres.

    Ours is compared with the nearest face, which it measures; the usual script's depth at the
    middle of the box with the z of the label, the middle of the object.
    """
    return [
        (
            one.frame,
            one.name,
            f"{one.label_m:.2f}",
            f"{one.true_m:.2f}",
            _metres(one.measured_m),
            _metres(one.sigma_m),
            _off(one.measured_m, one.true_m),
            _metres(one.usual_m),
            _off(one.usual_m, one.label_m),
        )
        for one in objects
    ]


def objects_text(objects: Sequence[JudgedObject]) -> str:
    """The rows as a table for the terminal."""
    return table_text(object_rows(objects), header=OBJECT_HEADER)


def objects_section(objects: Sequence[JudgedObject]) -> Section:
    """The rows as a part of a page."""
    return Section(
        "Each labelled object",
        "Distances in m. Ours is that of the nearest face in view; the usual script reads the "
        "depth at the middle of the box and is compared with the z of the label.",
        table=object_rows(objects),
        header=OBJECT_HEADER,
    )


def obstacles_section(
    folder: Path, obstacles: Mapping[str, Sequence[Obstacle]], times_s: Mapping[str, float]
) -> Section:
    """What was found, the nearest of each frame first, with pictures of a few frames.

    Args:
        folder: output folder of a run that has made pictures for the film.
        obstacles: of its frames, in order.
        times_s: of the frames.
    """
    rows = [
        (frame, name_text(one), distance_text(one), _size(one), speed_text(one) or NONE)
        for frame, found in obstacles.items()
        for one in found
    ]
    left_out = len(rows) - MOST_ROWS
    pictures = [
        Picture.photo(_small(read_picture(folder, frame, found, time_s=times_s[frame])), frame)
        for frame, found in _spread(list(obstacles.items()))
    ]
    return Section(
        "What was found",
        f"and {left_out} more, in obstacles.csv" if left_out > 0 else "",
        table=rows[:MOST_ROWS],
        header=("frame", "obstacle", "distance", "length x width x height", "speed"),
        cells="words",
        pictures=[PictureRow(tuple(pictures[i : i + 2])) for i in range(0, len(pictures), 2)],
    )


def _spread(
    frames: Sequence[tuple[str, Sequence[Obstacle]]],
) -> list[tuple[str, Sequence[Obstacle]]]:
    """A few of the frames in which something was found, evenly over the sequence."""
    with_some = [one for one in frames if one[1]] or list(frames)
    count = min(len(with_some), MOST_PICTURES)
    return [with_some[i * len(with_some) // count] for i in range(count)]


def _small(pixels: UInt8) -> UInt8:
    height, width = pixels.shape[:2]
    wide = min(width, PICTURE_PX)
    return resized(Panel(pixels, ""), (wide, round(height * wide / width)))


def _size(obstacle: Obstacle) -> str:
    box = obstacle.box
    return f"{box.length_m:.1f} x {box.width_m:.1f} x {box.height_m:.1f} m"


def _metres(value: float | None) -> str:
    return NONE if value is None else f"{value:.2f}"


def _off(value: float | None, true: float) -> str:
    return NONE if value is None else f"{value - true:+.2f}"
