"""The first pass, written every so many frames: a run that goes on need not walk again."""

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
from pseudolidar.running.folder import inside
from pseudolidar.running.mapped.odometry_film import drawing_name
from pseudolidar.running.mapped.state_file import decode_state, encode_state
from pseudolidar.running.mapped.stored import WORK_FOLDER
from pseudolidar.running.mapped.walk import Walk
from pseudolidar.running.run import Run

CHECKPOINT_FILE = f"{WORK_FOLDER}/walk.checkpoint"
# Frames between two checkpoints.
EVERY = 50
SCHEMA = 1
_log = logging.getLogger(__name__)


class Checkpoints:
    """Writes the state of a walk, and reads the last one.

    A run goes on with what it has written, read back, as one that was killed would: so both end
    with the same bytes, whatever the order in which a library keeps its points.

    Args:
        folder: output folder.
        decided_by: settings and calibration of the run; a state of another one is not read.
        places: file of the finder of loops.
        drawn: frames are drawn, too.
    """

    def __init__(
        self, folder: Path, decided_by: Mapping[str, Any], places: PlaceFile, *, drawn: bool
    ) -> None:
        self._folder, self._path, self._drawn = folder, folder / CHECKPOINT_FILE, drawn
        self._places = places
        self._outside = {"places": places}
        self._versions = {
            "schema": SCHEMA,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "run": hashlib.sha256(json.dumps(decided_by, sort_keys=True).encode()).hexdigest(),
        }

    def after(self, walk: Walk) -> Walk:
        """The walk to go on with after a frame; from time to time it is written.

        Raises:
            OutputError: the disk is full or gone.
        """
        if len(walk.placed) % EVERY:
            return walk
        data = encode_state(walk, self._outside)
        head = {**self._versions, "sha256": hashlib.sha256(data).hexdigest()}
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
        except (OSError, ValueError) as error:
            _log.info("odometry goes along the frames from the first one: %s", error)
            return None
        return walk

    def _check_frames(self, ids: list[str], run: Run, per_frame: Callable[[Any], Any]) -> None:
        if list(run.expected(per_frame)[: len(ids)]) != ids:
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
