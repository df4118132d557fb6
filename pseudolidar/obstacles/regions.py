"""Objects where somebody drew a box: the `measure this` tool."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from pseudolidar.errors import LabelError, UsageError
from pseudolidar.formats.regions import EVERY_FRAME, NO_CLASS, read_regions
from pseudolidar.formats.text import NUMBER
from pseudolidar.obstacles.sight import Sight
from pseudolidar.structures.box import Detection


@dataclass(frozen=True)
class Boxes:
    """Boxes of a file, or one that is typed: `boxes.csv`, or `480,180,512,202`.

    Args:
        path: of the file; None for a typed one.
        box_px: left, top, right, bottom of the typed one.
    """

    path: Path | None = None
    box_px: tuple[float, float, float, float] | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """From four numbers with commas, or a path.

        Raises:
            UsageError: numbers that are no box.
        """
        parts = [part.strip() for part in text.split(",")]
        numbers = [float(part) for part in parts if NUMBER.fullmatch(part)]
        # Where some are numbers and some are not, a box was meant, unless there is such a file.
        if not numbers or (len(numbers) < len(parts) and Path(text).exists()):
            return cls(path=Path(text))
        if not len(numbers) == len(parts) == 4 or not (
            numbers[0] < numbers[2] < math.inf and numbers[1] < numbers[3] < math.inf
        ):
            raise UsageError(
                f"{text!r}", want="LEFT,TOP,RIGHT,BOTTOM in px, left < right and top < bottom"
            )
        left, top, right, bottom = numbers
        return cls(box_px=(left, top, right, bottom))

    def __str__(self) -> str:
        if self.box_px is None:
            return str(self.path)
        return ",".join(f"{value:g}" for value in self.box_px)


@dataclass(frozen=True)
class Regions:
    """Boxes that somebody drew.

    Args:
        boxes: a .csv or .json file with left, top, right, bottom (px), and optionally frame, class
            and score; or one box for all frames, LEFT,TOP,RIGHT,BOTTOM.
        name: class of boxes that have none; a class that is known has a usual size.
    """

    boxes: Boxes
    name: str = NO_CLASS

    def load(self) -> DrawnRegions:
        """The detector.

        Raises:
            LabelError: the file cannot be read.
        """
        if self.boxes.path is not None:
            if not self.boxes.path.is_file():
                raise LabelError(
                    "no such file",
                    want="a .csv or .json file of boxes, or LEFT,TOP,RIGHT,BOTTOM in px",
                    fix="Check the path.",
                    path=self.boxes.path,
                )
            drawn = read_regions(self.boxes.path)
        else:
            assert self.boxes.box_px is not None
            drawn = {EVERY_FRAME: (Detection(NO_CLASS, self.boxes.box_px),)}
        return DrawnRegions(
            {frame: tuple(self._named(one) for one in ones) for frame, ones in drawn.items()},
            None if self.boxes.path is None else str(self.boxes.path),
        )

    def _named(self, detection: Detection) -> Detection:
        if detection.name != NO_CLASS:
            return detection
        return Detection(self.name or NO_CLASS, detection.box_px, detection.score)


@dataclass(frozen=True)
class DrawnRegions:
    """Hands over the boxes of a frame.

    Args:
        drawn: boxes by frame; under `EVERY_FRAME` those of all.
        path: where they are from, for errors.
    """

    drawn: Mapping[str, tuple[Detection, ...]]
    path: str | None

    def meant_by(self, meant: Callable[[str], str | None]) -> DrawnRegions:
        """The same boxes by the ids of a source, in place of the names that somebody wrote.

        Names that mean the same frame have their boxes together; boxes of every frame stay so.

        Args:
            meant: gives the id that a name means; None where it means none, and the name stays.
        """
        drawn = {EVERY_FRAME: self.drawn.get(EVERY_FRAME, ())}
        for name, boxes in self.drawn.items():
            if name != EVERY_FRAME:
                frame = meant(name) or name
                drawn[frame] = (*drawn.get(frame, ()), *boxes)
        return DrawnRegions(drawn, self.path)

    def boxes_of(self, frame_id: str) -> tuple[Detection, ...]:
        """The boxes of a frame, wherever they lie."""
        return (*self.drawn.get(EVERY_FRAME, ()), *self.drawn.get(frame_id, ()))

    def __call__(self, sight: Sight) -> tuple[Detection, ...]:
        """The boxes of a frame; none is a valid result.

        Raises:
            LabelError: a box lies outside of the picture.
        """
        found = self.boxes_of(sight.id)
        width, height = sight.camera.size_px
        for one in found:
            left, top, right, bottom = one.box_px
            if right <= 0 or bottom <= 0 or left >= width - 1 or top >= height - 1:
                raise LabelError(
                    f"box {','.join(f'{value:g}' for value in one.box_px)}",
                    want=f"one in the picture of {width}x{height}",
                    fix="Pixels count from the upper left corner, LEFT,TOP,RIGHT,BOTTOM.",
                    path=self.path,
                    where=f"frame {sight.id}",
                )
        return found
