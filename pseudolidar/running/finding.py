"""A frame to the obstacles in it, and the files of that: what each frame of `obstacles` passes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pseudolidar.formats.mcap.content import DEFAULT_CONTENT, McapContent
from pseudolidar.formats.pictures.image import encode_png
from pseudolidar.obstacles.corridor import Corridor, near_mask
from pseudolidar.obstacles.corridor_view import corridor_view
from pseudolidar.obstacles.detector import Detector
from pseudolidar.obstacles.measure import measured
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.products.corridor_table import view_figures
from pseudolidar.running.products.found import Found, found_file
from pseudolidar.running.products.found_clouds import FoundOutputs
from pseudolidar.running.products.label_classes import LABELLED
from pseudolidar.running.products.obstacle_film import ObstacleArtist
from pseudolidar.running.products.product import Product
from pseudolidar.running.products.told_recording import found_parts
from pseudolidar.running.sighting import Seen, SightFrame
from pseudolidar.structures.recorded import Frame

NEAR_FOLDER = "near"


@dataclass(frozen=True)
class FindFrame:
    """One frame to its obstacles: pure, picklable, one thread.

    Args:
        sight: frame to depth and ground.
        detect: says where objects are; None where nothing is asked.
        corridor: what is watched, if anything.
        near_m: things nearer than this get a mask; None for none.
        to: what else is written of a frame.
        content: what the recording holds, where there is to be one.
        artist: makes pictures to draw obstacles into.
        pictured: the frames that it makes them of; None for all, as a film needs.
    """

    sight: SightFrame
    detect: Detector | None
    corridor: Corridor | None = None
    near_m: float | None = None
    to: FoundOutputs = field(default_factory=FoundOutputs)
    content: McapContent = DEFAULT_CONTENT
    artist: ObstacleArtist = field(default_factory=ObstacleArtist)
    pictured: frozenset[str] | None = None

    def __call__(self, frame: Frame) -> Product:
        """Find, and encode what was found.

        Raises:
            PseudolidarError: as `found`.
        """
        return self.product(self.found(frame))

    def product(self, found: Found) -> Product:
        """Everything that is committed of a frame, encoded."""
        frame = found.frame
        files = [found_file(found), *self.to.files(found)]
        if self.near_m is not None:
            mask = near_mask(found.seen.sight, self.near_m)
            files.append(OutputFile.of(f"{NEAR_FOLDER}/{frame.id}.png", encode_png(mask)))
        if self.pictured is None or frame.id in self.pictured:
            files += self.artist.files(frame, found.seen)
        parts = found_parts(found, self.content) if self.to.recording else {}
        return Product(tuple(files), parts, figures(found))

    def found(self, frame: Frame) -> Found:
        """Match, reproject, detect, measure; the nearest obstacle first.

        Raises:
            PairIdentical, LowTexture, MapEmpty: there is nothing to be seen.
            LabelError: the detector has nothing to go by.
        """
        return found_in(frame, self.sight(frame), self.detect, self.corridor)


@dataclass(frozen=True, eq=False)
class FoundProduct:
    """What is committed of a frame, and what it was made of.

    Args:
        product: to be committed.
        found: for those who look on; None where nobody does.
    """

    product: Product
    found: Found | None = None


@dataclass(frozen=True)
class FindShown:
    """The same as `find`, for a run that somebody may look on at.

    Args:
        find: frame to its obstacles.
        shown: whether somebody does.
    """

    find: FindFrame
    shown: bool = False

    def __call__(self, frame: Frame) -> FoundProduct:
        """Find, encode, and keep what was found where it is shown.

        Raises:
            PseudolidarError: as `FindFrame.found`.
        """
        found = self.find.found(frame)
        return FoundProduct(self.find.product(found), found if self.shown else None)


def found_in(frame: Frame, seen: Seen, detect: Detector | None, corridor: Corridor | None) -> Found:
    """Detect and measure in what is seen; the nearest obstacle first.

    Args:
        frame: that it is seen in.
        seen: its depth and ground.
        detect: says where objects are; None where nothing is asked.
        corridor: what is watched, if anything.

    Raises:
        LabelError: the detector has nothing to go by.
    """
    detections = () if detect is None else detect(seen.sight)
    obstacles = measured(seen.sight, detections)
    nearest_first = sorted(obstacles, key=lambda obstacle: obstacle.distance_m)
    view = None if corridor is None else corridor_view(seen.sight, corridor)
    return Found(frame, seen, tuple(nearest_first), view, searched=detect is not None)


def figures(found: Found) -> dict[str, Any]:
    """Of one frame, for the report."""
    told: dict[str, Any] = {
        "obstacles": len(found.obstacles),
        "density": float(found.seen.sight.depth.valid.mean()),
    }
    labels = found.seen.sight.labels
    if labels is not None and found.searched:
        told[LABELLED] = sorted({one.detection.name for one in labels if not one.ignore})
    if found.frame.notes:
        told["notes"] = list(found.frame.notes)
    if found.obstacles:
        told["nearest_m"] = found.obstacles[0].distance_m
    return told | view_figures(found.corridor)
