"""The first pass, written from time to time: a run that goes on need not walk again."""

from __future__ import annotations

import hashlib
import json
import logging
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pseudolidar.formats.atomic import write_atomic
from pseudolidar.mapping.place_store import PlaceFile
from pseudolidar.running.crew.crew_plan import CrewPlan
from pseudolidar.running.folder import inside
from pseudolidar.running.mapped.odometry_film import drawing_name
from pseudolidar.running.mapped.state_file import decode_state, encode_state
from pseudolidar.running.mapped.stored import WORK_FOLDER
from pseudolidar.running.mapped.walk import Walk
from pseudolidar.running.run import Run

CHECKPOINT_FILE = f"{WORK_FOLDER}/walk.checkpoint"
# Frames from one checkpoint to the next; of long walks a 20th of the frames, for what is written of
# each stays in it: all checkpoints together take some 20 times what the last one takes.
EVERY, SHARE = 50, 20
PACKAGE = Path(__file__).parents[2]
# What states are made of and by, in the package: others are not read.
SOURCES = (
    "structures/*.py",
    "geometry/*.py",
    "mapping/*.py",
    "running/mapped/walk*.py",
    "running/mapped/state_file.py",
)
# What states raise that are not what they were.
STALE = (OSError, ValueError, AttributeError, TypeError, RecursionError)
_log = logging.getLogger(__name__)


class Checkpoints:
    """Writes the state of a walk, and reads the last one.

    A run goes on with what it has written, read back, as one that was killed would: so both end
    with the same bytes, whatever the order in which a library keeps its points.

    Args:
        folder: output folder.
        decided_by: settings and calibration of the run; a state of another one is not read.
        places: file of the finder of loops; None where none are looked for.
        drawn: frames are drawn, too.
        crew: how frames that failed are tried again.
    """

    def __init__(
        self,
        folder: Path,
        decided_by: Mapping[str, Any],
        places: PlaceFile | None,
        *,
        drawn: bool,
        crew: CrewPlan,
    ) -> None:
        self._folder, self._path, self._drawn = folder, folder / CHECKPOINT_FILE, drawn
        self._places, self._crew = places, crew
        self._outside = {} if places is None else {"places": places}
        self._versions = {
            "sources": sources_digest(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "run": hashlib.sha256(json.dumps(decided_by, sort_keys=True).encode()).hexdigest(),
        }

    def after(self, walk: Walk) -> Walk:
        """The walk to go on with after a frame; from time to time it is written.

        Raises:
            OutputError: the disk is full or gone.
        """
        if not due(len(walk.placed)):
            return walk
        data = encode_state(walk, self._outside)
        head = {**self._versions, "sha256": hashlib.sha256(data).hexdigest()}
        if self._places is not None:
            self._places.sync()
        write_atomic(self._path, json.dumps(head).encode() + b"\n" + data)
        again = decode_state(data, self._outside)
        assert isinstance(again, Walk)
        return again

    def last(self, run: Run, per_frame: Callable[[Any], Any]) -> Walk | None:
        """The walk as it was written last; None where there is none of the frames of this run.

        Args:
            run: that goes on. Frames that it skipped are tried first: one that is mended now
                belongs between those that the walk has.
            per_frame: with which they are tried.
        """
        try:
            head, _, data = self._path.read_bytes().partition(b"\n")
            walk = self._read(json.loads(head), data)
            self._check_frames([one.id for one in walk.placed], run, per_frame)
        except FileNotFoundError:
            return None
        except STALE as error:
            _log.info("odometry goes along the frames from the first one: %s", error)
            return None
        return walk

    def _check_frames(self, ids: list[str], run: Run, per_frame: Callable[[Any], Any]) -> None:
        if list(run.expected(per_frame, crew=self._crew)[: len(ids)]) != ids:
            raise ValueError("they are others than before")
        if not run.committed.issuperset(ids):
            raise ValueError("disparities are missing or damaged")
        drawings = (inside(self._folder, drawing_name(one)) for one in ids)
        if self._drawn and not all(drawing.exists() for drawing in drawings):
            raise ValueError("drawings are missing")

    def _read(self, head: Any, data: bytes) -> Walk:
        wanted = {**self._versions, "sha256": hashlib.sha256(data).hexdigest()}
        if head != wanted:
            raise ValueError("its checkpoint is of another version or other settings, or damaged")
        walk = decode_state(data, self._outside)
        if not isinstance(walk, Walk) or not walk.whole:
            raise ValueError("places that loops remember are missing")
        return walk


def due(frames: int) -> bool:
    """Whether the walk is written after so many frames: the same ones in every run."""
    at = EVERY
    while at < frames:
        at += max(EVERY, at // SHARE)
    return at == frames


def sources_digest() -> str:
    """Of all that decides what is in a state and how it goes on, whatever its version is called."""
    digest = hashlib.sha256()
    for file in sorted(file for pattern in SOURCES for file in PACKAGE.glob(pattern)):
        digest.update(f"{file.relative_to(PACKAGE)}\0{file.stat().st_size}\0".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()
