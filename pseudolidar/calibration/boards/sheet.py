"""A board on paper, to scale, with rulers to check the print and what to type for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pseudolidar.calibration.boards.board import Board, BoardName
from pseudolidar.calibration.boards.shapes import shapes_of
from pseudolidar.errors import UsageError
from pseudolidar.formats.drawing.page import Page, Text
from pseudolidar.structures.arrays import Float64

Paper = Literal["a4", "a3", "a2", "a1", "a0", "letter", "tabloid"]
# Short and long side, mm.
PAPERS: dict[Paper, tuple[float, float]] = {
    "a4": (210, 297),
    "a3": (297, 420),
    "a2": (420, 594),
    "a1": (594, 841),
    "a0": (841, 1189),
    "letter": (215.9, 279.4),
    "tabloid": (279.4, 431.8),
}
MM = 1000.0
# Edges that printers leave white; room for rulers at the left and at the bottom, and for words.
MARGIN_MM, RULER_MM, WORDS_MM = 8.0, 12.0, 7.0
TICK_MM, LONG_TICK_MM, LINE_MM, STEP_MM = 2.0, 4.0, 0.3, 10.0
TYPE_MM = 2.6
# Every so many ticks is a long one; room between a ruler and its numbers; lines of words apart.
LONG_EVERY, BELOW_MM, LEADING = 5, 0.8, 1.35
# Squares of boards whose size nobody says are whole millimetres.
WHOLE_MM = 1.0


@dataclass(frozen=True, eq=False)
class Sheet:
    """A board on a page.

    Args:
        board: which one.
        paper: on which paper.
        page: what is drawn.
    """

    board: Board
    paper: Paper
    page: Page

    @property
    def command(self) -> str:
        """What to type to calibrate with it."""
        return command_of(self.board)


def command_of(board: Board) -> str:
    """What to type to calibrate with a board."""
    return f"pseudolidar calibrate PICTURES {_flags_of(board)}"


def _flags_of(board: Board) -> str:
    flags = f"--board {board.name} --square {board.square_m:g}"
    if board.name.kind in ("charuco", "aprilgrid"):
        flags += f" --marker {board.marker_m:g} --dictionary {board.dictionary}"
    return flags


def fitting_square_m(name: BoardName, paper: Paper) -> float:
    """The largest square of whole millimetres with which a board fits on a paper.

    Raises:
        UsageError: none does.
    """
    short, long = PAPERS[paper]
    for size_mm in np.arange(np.floor(long), 0, -WHOLE_MM):
        if _fits(_size_mm(Board.of(name, float(size_mm) / MM)), (short, long)):
            return float(size_mm) / MM
    raise UsageError(f"a {name} on {paper}", want="a larger --paper", where="--paper")


def sheet_of(board: Board, paper: Paper) -> Sheet:
    """Draw a board in the middle of a paper.

    Raises:
        UsageError: it does not fit; says on which it would.
    """
    size_mm, (short, long) = _size_mm(board), PAPERS[paper]
    if not _fits(size_mm, (short, long)):
        larger = [name for name, sides in PAPERS.items() if _fits(size_mm, sides)]
        raise UsageError(
            f"a {board.name} of {size_mm[0]:.0f}x{size_mm[1]:.0f} mm on {paper}",
            want=f"a board that fits with rulers and margins, or --paper {larger[0]}"
            if larger
            else "a smaller board",
            fix="Make squares smaller, or leave --square out: it is then as large as fits.",
            where="--square",
        )
    room = _room_mm(size_mm)
    width, height = (short, long) if room[0] <= short and room[1] <= long else (long, short)
    left = MARGIN_MM + RULER_MM + (width - room[0]) / 2
    top = MARGIN_MM + (height - room[1]) / 2
    shapes = shapes_of(board)
    origin = np.array([left, top]) - shapes.low_m * MM
    boxes, circles = shapes.rectangles_m * MM, shapes.circles_m * MM
    boxes[:, :2] += origin
    circles[:, :2] += origin
    lines, numbers = _rulers(left, top, size_mm)
    words = _words(board, MARGIN_MM, height)
    page = Page(
        width,
        height,
        np.concatenate([boxes, lines]),
        circles,
        (*numbers, *words),
        f"{board.name}, {board.square_m * MM:g} mm",
    )
    return Sheet(board, paper, page)


def _size_mm(board: Board) -> tuple[float, float]:
    width_m, height_m = _shapes_size_m(board)
    return width_m * MM, height_m * MM


def _shapes_size_m(board: Board) -> tuple[float, float]:
    """Width and height of what is drawn of a board, m, without drawing it."""
    points = board.points_m[:, :2]
    columns, rows = np.ptp(points, axis=0).tolist()
    around = board.marker_m if board.name.kind == "aprilgrid" else board.square_m
    return columns + 2 * around, rows + 2 * around


def _room_mm(size_mm: tuple[float, float]) -> tuple[float, float]:
    return (
        size_mm[0] + RULER_MM + 2 * MARGIN_MM,
        size_mm[1] + RULER_MM + WORDS_MM + 2 * MARGIN_MM,
    )


def _fits(size_mm: tuple[float, float], sides_mm: tuple[float, float]) -> bool:
    width, height = _room_mm(size_mm)
    return (width <= sides_mm[0] and height <= sides_mm[1]) or (
        width <= sides_mm[1] and height <= sides_mm[0]
    )


def _rulers(
    left: float, top: float, size_mm: tuple[float, float]
) -> tuple[Float64, tuple[Text, ...]]:
    """A ruler below the board and one at its left: printers may stretch one way alone."""
    lines: list[list[float]] = []
    texts: list[Text] = []
    lengths = [STEP_MM * np.floor(side / STEP_MM) for side in size_mm]
    x, y = left - RULER_MM / 2, top + size_mm[1] + RULER_MM / 2
    lines.append([left, y, lengths[0], LINE_MM])
    lines.append([x, top, LINE_MM, lengths[1]])
    for number in range(int(lengths[0] / STEP_MM) + 1):
        tick = LONG_TICK_MM if number % LONG_EVERY == 0 else TICK_MM
        lines.append([left + number * STEP_MM - LINE_MM / 2, y - tick, LINE_MM, tick])
    for number in range(int(lengths[1] / STEP_MM) + 1):
        tick = LONG_TICK_MM if number % LONG_EVERY == 0 else TICK_MM
        lines.append([x - tick, top + number * STEP_MM - LINE_MM / 2, tick, LINE_MM])
    below = y + TYPE_MM + BELOW_MM
    texts.append(Text(left, below, TYPE_MM, "0", centred=True))
    texts.append(Text(x - LONG_TICK_MM - 2, top + TYPE_MM / 3, TYPE_MM, "0"))
    texts.append(Text(left + lengths[0], below, TYPE_MM, f"{lengths[0]:.0f} mm", centred=True))
    texts.append(Text(x - LONG_TICK_MM, top + lengths[1] + TYPE_MM + BELOW_MM, TYPE_MM,
                      f"{lengths[1]:.0f} mm"))  # fmt: skip
    return np.array(lines), tuple(texts)


def _words(board: Board, left: float, height: float) -> tuple[Text, ...]:
    first = (
        f"{board.name}, square {board.square_m * MM:g} mm. Print without scaling and measure the "
        "rulers; if they are off, measure the squares and type their size."
    )
    lines = (first, command_of(board))
    return tuple(
        Text(left, height - MARGIN_MM - (1 - n) * LEADING * TYPE_MM, TYPE_MM, words)
        for n, words in enumerate(lines)
    )
