"""Remembered places, on disk: memory does not grow with them, but for a note of each."""

from __future__ import annotations

import contextlib
import os
import tempfile
import zlib
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Self, overload

import numpy as np

from pseudolidar.formats.atomic import output_error, write_all
from pseudolidar.mapping.place import Place
from pseudolidar.structures.arrays import Float64
from pseudolidar.structures.loop import LoopEnd

# So many places are in memory, those that were asked for last: neighbours are asked for together.
MOST_LOADED = 32
# What is kept of a point: uv, d, descriptor.
POINT = np.dtype([("uv", "<f4", 2), ("d", "<f4"), ("descriptor", "u1", 32)])
# And of a cell: depth, grey.
CELL = np.dtype([("depth_m", "<f2"), ("grey", "u1")])


class PlaceFile:
    """A file that places are kept in, each where its note says; closed when a `with` block ends.

    Args:
        path: of the file, which is made or gone on with; None for one that has no name and goes
            with the process.

    Raises:
        OutputError: it cannot be made.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = Path(tempfile.gettempdir()) if path is None else path
        with self._disk_named():
            self._file: BinaryIO
            if path is None:
                self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  # as long as this
                return
            path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW
            self._file = os.fdopen(os.open(path, flags, 0o644), "r+b", buffering=0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: bytes, offset: int) -> None:
        """Put bytes at a place.

        Raises:
            OutputError: the disk is full or gone.
        """
        with self._disk_named():
            self._file.seek(offset)
            write_all(self._file, data)

    def read(self, size: int, offset: int) -> bytes:
        """So many bytes from a place; fewer where the file ends.

        Raises:
            OutputError: the disk is gone.
        """
        with self._disk_named():
            self._file.seek(offset)
            return self._file.read(size)

    def sync(self) -> None:
        """What was written is durable.

        Raises:
            OutputError: the disk is full or gone.
        """
        with self._disk_named():
            os.fsync(self._file.fileno())

    @contextlib.contextmanager
    def _disk_named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise output_error(self._path, error) from error


@dataclass(frozen=True, eq=False)
class PlaceNote:
    """What is in memory of a place.

    Args:
        number: of the place, counted from the first.
        end: which frame it was.
        T_odom_camera: (4, 4) where odometry had it.
        along_m: path from the piece's beginning.
        points: how many.
        cells: rows and columns.
        offset: of its bytes in the file.
        crc32: of them.
    """

    number: int
    end: LoopEnd
    T_odom_camera: Float64
    along_m: float
    points: int
    cells: tuple[int, int]
    offset: int
    crc32: int

    @property
    def bytes(self) -> int:
        """What it takes in the file."""
        return self.points * POINT.itemsize + self.cells[0] * self.cells[1] * CELL.itemsize


class PlaceStore(Sequence[PlaceNote]):
    """Places in their order.

    Args:
        file: where they are kept.
    """

    def __init__(self, file: PlaceFile) -> None:
        self._file = file
        self._notes: list[PlaceNote] = []
        self._loaded: OrderedDict[int, Place] = OrderedDict()

    def __len__(self) -> int:
        return len(self._notes)

    @overload
    def __getitem__(self, index: int) -> PlaceNote: ...
    @overload
    def __getitem__(self, index: slice) -> list[PlaceNote]: ...
    def __getitem__(self, index: int | slice) -> PlaceNote | list[PlaceNote]:
        """The note of a place."""
        return self._notes[index]

    @property
    def bytes(self) -> int:
        """What all take in the file."""
        return self._notes[-1].offset + self._notes[-1].bytes if self._notes else 0

    def add(self, place: Place) -> None:
        """The next place.

        Raises:
            OutputError: the disk is full or gone.
        """
        points = np.empty(len(place), POINT)
        points["uv"], points["d"], points["descriptor"] = place.uv, place.d, place.descriptors
        height, width = place.grey_cells.shape
        cells = np.empty((height, width), CELL)
        cells["depth_m"], cells["grey"] = place.depth_cells_m, place.grey_cells
        data = points.tobytes() + cells.tobytes()
        note = PlaceNote(
            place.number,
            place.end,
            place.T_odom_camera,
            place.along_m,
            len(place),
            (height, width),
            self.bytes,
            zlib.crc32(data),
        )
        self._file.write(data, note.offset)
        self._notes.append(note)

    @property
    def whole(self) -> bool:
        """Whether the file has all of them as they were added."""
        read = (self._file.read(note.bytes, note.offset) for note in self._notes)
        return all(
            zlib.crc32(data) == note.crc32 for data, note in zip(read, self._notes, strict=True)
        )

    def load(self, number: int) -> Place:
        """A place with all that is kept of it.

        Raises:
            OutputError: the disk is gone.
        """
        if number in self._loaded:
            self._loaded.move_to_end(number)
            return self._loaded[number]
        place = _place(self._notes[number], self._file)
        self._loaded[number] = place
        if len(self._loaded) > MOST_LOADED:
            self._loaded.popitem(last=False)
        return place


def _place(note: PlaceNote, file: PlaceFile) -> Place:
    data = file.read(note.bytes, note.offset)
    points = np.frombuffer(data, POINT, note.points)
    cells = np.frombuffer(data, CELL, offset=note.points * POINT.itemsize).reshape(note.cells)
    return Place(
        note.number,
        note.end,
        note.T_odom_camera,
        note.along_m,
        points["uv"].copy(),
        points["d"].copy(),
        points["descriptor"].copy(),
        cells["depth_m"].copy(),
        cells["grey"].copy(),
    )
