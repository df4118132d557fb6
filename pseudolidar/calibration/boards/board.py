"""The boards that cameras are calibrated with: their names, sizes and corners."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, Self, get_args

import numpy as np

from pseudolidar.errors import UsageError
from pseudolidar.structures.arrays import Float64, Int64

Kind = Literal["chessboard", "charuco", "circles", "acircles", "aprilgrid"]
KINDS: tuple[str, ...] = get_args(Kind)
EXAMPLES = "chessboard:9x6, charuco:8x6, circles:7x6, acircles:4x11 or aprilgrid:6x6"
# Fewest and most in a row or column: less tells nothing about a lens, more is a slip of the hand.
FEWEST, MOST = {"chessboard": 3, "charuco": 3, "circles": 3, "acircles": 3, "aprilgrid": 1}, 60
# Side of a marker of a ChArUco board as a share of the square; gap of an AprilGrid as a share of
# the tag, as Kalibr's example has it.
MARKER_SHARE, APRIL_GAP_SHARE = 0.75, 0.3
# Sides that boards can have: longer ones are in millimetres; of an AprilGrid's gap in tags.
LARGEST_SQUARE_M, MOST_GAP_SHARE = 2.0, 3.0
DICTIONARIES = {
    "4x4": "DICT_4X4_250",
    "5x5": "DICT_5X5_250",
    "6x6": "DICT_6X6_250",
    "7x7": "DICT_7X7_250",
    "36h11": "DICT_APRILTAG_36h11",
}
Dictionary = Literal["4x4", "5x5", "6x6", "7x7", "36h11"]


@dataclass(frozen=True)
class BoardName:
    """Kind and counts of a board, such as `chessboard:9x6`.

    Args:
        kind: of its pattern.
        columns: inner corners of a chessboard, squares of a ChArUco board, circles in a row, tags
            of an AprilGrid.
        rows: the same, of a column.

    Raises:
        UsageError: a board that cannot be.
    """

    kind: Kind
    columns: int
    rows: int

    def __post_init__(self) -> None:
        fewest = FEWEST[self.kind]
        if not all(fewest <= count <= MOST for count in (self.columns, self.rows)):
            raise UsageError(
                f"a {self.kind} of {self.columns}x{self.rows}",
                want=f"{fewest} to {MOST} in each direction",
                where="--board",
            )

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `chessboard:9x6`.

        Raises:
            UsageError: it is no such text.
        """
        found = re.fullmatch(r"([a-z]+):([0-9]{1,4})x([0-9]{1,4})", text)
        if not found or found[1] not in KINDS:
            raise UsageError(
                f"board {text!r}",
                want=EXAMPLES,
                fix="Chessboards count inner corners, ChArUco boards squares.",
                where="--board",
            )
        kind: Kind = next(kind for kind in get_args(Kind) if kind == found[1])
        return cls(kind, int(found[2]), int(found[3]))

    def __str__(self) -> str:
        return f"{self.kind}:{self.columns}x{self.rows}"


@dataclass(frozen=True)
class Board:
    """A board of known size.

    Args:
        name: its kind and counts.
        square_m: side of a square of a chessboard or ChArUco board; distance of neighbouring
            circles, of asymmetric ones that of neighbouring rows; side of an AprilGrid's tag.
        marker_m: side of a ChArUco marker; gap between the tags of an AprilGrid.
        dictionary: of the markers.

    Raises:
        UsageError: sizes that cannot be.
    """

    name: BoardName
    square_m: float
    marker_m: float
    dictionary: Dictionary

    @classmethod
    def of(
        cls,
        name: BoardName,
        square_m: float,
        *,
        marker_m: float | None = None,
        dictionary: Dictionary | None = None,
    ) -> Self:
        """The board with the usual markers where none are named.

        Args:
            name: its kind and counts.
            square_m: side of a square, as `Board` has it.
            marker_m: side of a marker or gap; by default the usual share of the square.
            dictionary: of the markers; by default that of the kind.
        """
        share = APRIL_GAP_SHARE if name.kind == "aprilgrid" else MARKER_SHARE
        usual: Dictionary = "36h11" if name.kind == "aprilgrid" else "5x5"
        marker_m = square_m * share if marker_m is None else marker_m
        return cls(name, square_m, marker_m, dictionary or usual)

    def __post_init__(self) -> None:
        if not 0 < self.square_m <= LARGEST_SQUARE_M:
            raise UsageError(
                f"squares of {self.square_m:g} m",
                want="metres, such as 0.025",
                fix="Is it in millimetres? Write metres.",
                where="--square",
            )
        largest = self.square_m * (MOST_GAP_SHARE if self.name.kind == "aprilgrid" else 1.0)
        if not 0 < self.marker_m < largest:
            raise UsageError(
                f"markers of {self.marker_m:g} m on squares of {self.square_m:g} m",
                want=f"less than {largest:g} m",
                where="--marker",
            )

    @property
    def grid(self) -> tuple[int, int]:
        """(columns, rows) of what is found in pictures: corners or centres."""
        columns, rows = self.name.columns, self.name.rows
        match self.name.kind:
            case "charuco":
                return columns - 1, rows - 1
            case "aprilgrid":
                return 2 * columns, 2 * rows
            case _:
                return columns, rows

    @property
    def points_m(self) -> Float64:
        """(N, 3) corners by id in the board's frame, m: x along its rows, y down, z away."""
        columns, rows = self.grid
        column, row = np.meshgrid(np.arange(columns), np.arange(rows))
        x, y = column.ravel().astype(np.float64), row.ravel().astype(np.float64)
        if self.name.kind == "acircles":
            x = 2 * x + y % 2
        if self.name.kind == "aprilgrid":
            x, y = self._april_units(x), self._april_units(y)
        return np.stack([x, y, np.zeros(len(x))], axis=1) * self.square_m

    def turns(self) -> tuple[Int64, ...]:
        """The ways in which the board can be read that fit a picture alike.

        Each is (N,) int64: what the corner that was called i is called then. The first is the
        identity. Markers leave no doubt; a chessboard can be read from both ends.
        """
        columns, rows = self.grid
        ids: Int64 = np.arange(columns * rows, dtype=np.int64).reshape(rows, columns)
        if self.name.kind in ("charuco", "aprilgrid"):
            return (ids.ravel(),)
        if self.name.kind == "acircles":
            # Turned by half, rows begin where they did only if their number is odd.
            return (ids.ravel(), ids[::-1, ::-1].ravel()) if rows % 2 == 0 else (ids.ravel(),)
        turned = [ids, ids[::-1, ::-1]]
        if columns == rows:
            turned += [np.rot90(ids), np.rot90(ids, -1)]
        return tuple(np.ascontiguousarray(way).ravel() for way in turned)

    def _april_units(self, corner: Float64) -> Float64:
        """Places of corners along an axis in sides of a tag: two for each tag, then a gap."""
        gap = self.marker_m / self.square_m
        return np.asarray(corner // 2 * (1 + gap) + corner % 2)

    def __str__(self) -> str:
        return f"{self.name}, {self.square_m * 1000:g} mm"
