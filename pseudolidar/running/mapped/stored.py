"""Disparities of frames, matched once and stored: what a map is made of is gone through twice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.errors import LowTexture, PairIdentical, PseudolidarError
from pseudolidar.formats.pictures.stored_disparity import decode_disparity, encode_disparity
from pseudolidar.formats.whole_read import read_whole
from pseudolidar.obstacles.detector import Detector
from pseudolidar.running.folder import inside
from pseudolidar.running.journal.record import OutputFile
from pseudolidar.running.matching import MatchFrame
from pseudolidar.running.products.product import Product
from pseudolidar.running.sighting import SightFrame
from pseudolidar.structures.box import Detection
from pseudolidar.structures.disparity import DisparityMap
from pseudolidar.structures.frame import StereoFrame

# Hidden: it is what a run works with, not what it was asked for.
WORK_FOLDER = ".work"
# Where the finder of loops keeps the places that it remembers.
PLACES_FILE = f"{WORK_FOLDER}/places"


@dataclass(frozen=True, eq=False)
class MatchedFrame:
    """A frame with its disparities.

    Args:
        frame: as its source had it.
        disparity: of its left image, as it is stored: a run that goes on has the same.
        movable: things in its left image that may move by themselves.
        product: what is to be committed.
    """

    frame: StereoFrame
    disparity: DisparityMap
    movable: tuple[Detection, ...]
    product: Product


@dataclass(frozen=True)
class MatchOnce:
    """Matches a frame, or reads what an earlier run matched: picklable, one thread.

    Args:
        match: pair to disparity.
        folder: output folder.
        known: ids of frames whose disparities are stored there.
        sight: frame to what things are looked for in; None where nothing is masked.
        detect: says which things may move.
    """

    match: MatchFrame
    folder: Path
    known: frozenset[str] = frozenset()
    sight: SightFrame | None = None
    detect: Detector | None = None

    def __call__(self, frame: StereoFrame) -> MatchedFrame:
        """Match, store, detect.

        A pair that shows nothing has no disparity, and a note that says so: it may have a scan, and
        it belongs between the frames beside it.
        """
        name, notes = stored_name(frame.id), list(frame.notes)
        data = self._stored(frame) if frame.id in self.known else None
        if data is None:
            data = encode_disparity(self._matched(frame, notes))
        disparity = decode_disparity(data, inside(self.folder, name))
        looked_at = self.sight is not None and disparity.valid.any()
        movable = self._movable(frame) if looked_at else ()
        figures: dict[str, Any] = {"density": disparity.density}
        if notes:
            figures["notes"] = notes
        return MatchedFrame(
            frame, disparity, movable, Product((OutputFile.of(name, data),), figures=figures)
        )

    def product(self, frame: StereoFrame) -> Product:
        """What is to be committed of a frame, alone; raises as the call does."""
        return self(frame).product

    def _matched(self, frame: StereoFrame, notes: list[str]) -> DisparityMap:
        try:
            return self.match.disparity(frame)
        except (PairIdentical, LowTexture) as error:
            notes.append(f"{error.code}: {error.got}")
            return DisparityMap(np.full(frame.left.shape[:2], np.nan, np.float32))

    def _movable(self, frame: StereoFrame) -> tuple[Detection, ...]:
        assert self.sight is not None
        assert self.detect is not None
        return tuple(self.detect(self.sight(frame).sight))

    def _stored(self, frame: StereoFrame) -> bytes | None:
        path = inside(self.folder, stored_name(frame.id))
        try:
            data = read_whole(path)
            decode_disparity(data, path)
        except (PseudolidarError, OSError):
            return None  # it is matched again
        return data


def stored_name(frame_id: str) -> str:
    """Name of the file of a frame's disparities in the output folder."""
    return f"{WORK_FOLDER}/{frame_id}.disparity"


def read_stored(folder: Path, frame_id: str) -> DisparityMap:
    """The disparities that a run has stored.

    Raises:
        ImageUnreadable: the file was changed by somebody.
        OSError: it is not there.
    """
    path = inside(folder, stored_name(frame_id))
    return decode_disparity(read_whole(path), path)
