"""Draw a calibration board to scale, for printing."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pseudolidar.calibration.boards.board import EXAMPLES, KINDS, Board, BoardName, Dictionary
from pseudolidar.calibration.boards.sheet import Paper, Sheet, fitting_square_m, sheet_of
from pseudolidar.errors import ALL_DONE, UsageError
from pseudolidar.formats.atomic import write_atomic
from pseudolidar.running.field_markers import RUN_ONLY, THIS_TIME
from pseudolidar.running.new_file import check_kind, check_new_file

# Counts of boards of which only the kind is said: such as fill a sheet of A4.
USUAL = {"chessboard": "9x6", "charuco": "8x6", "circles": "9x7", "acircles": "4x11",
         "aprilgrid": "6x6"}  # fmt: skip
# Pixels an inch of a PNG: what screens have, and what the finest printers have.
RESOLUTIONS = (72, 2400)


@dataclass(frozen=True)
class BoardType:
    """A board, or its kind alone.

    Args:
        name: the board.
    """

    name: BoardName

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `charuco:8x6` or `charuco`.

        Raises:
            UsageError: it is neither.
        """
        if text in KINDS:
            return cls(BoardName.parse(f"{text}:{USUAL[text]}"))
        if re.fullmatch(r"[a-z]+:.*", text):
            return cls(BoardName.parse(text))
        raise UsageError(f"board {text!r}", want=f"{EXAMPLES}, or one of {', '.join(KINDS)}",
                         where="--type")  # fmt: skip

    def __str__(self) -> str:
        return str(self.name)


@dataclass(frozen=True)
class DrawBoard:
    """Draw a calibration board to scale, with rulers that show whether the print is right.

    Print it without scaling ("actual size"), glue it onto something flat and stiff, measure the
    rulers, and calibrate with what the sheet says.

        pseudolidar board --type charuco --out board.pdf
        pseudolidar board --type chessboard:9x6 --square 0.05 --paper a2 --out board.svg
        pseudolidar board --type aprilgrid:6x6 --out board.png

    Args:
        type: `chessboard:9x6` (inner corners), `charuco:8x6` (squares), `circles:9x7`,
            `acircles:4x11` (asymmetric), `aprilgrid:6x6` (tags), or the kind alone.
        out: the file: PDF and SVG hold vectors, PNG pixels.
        square: side of a square, m; distance of neighbouring circles, of asymmetric ones that of
            neighbouring rows; side of an AprilGrid's tag. By default as large as fits.
        marker: side of a ChArUco marker, m (by default 3/4 of the square); gap between the tags of
            an AprilGrid (0.3 of the tag).
        dictionary: of the markers: 4x4, 5x5 (ChArUco's default), 6x6, 7x7 or 36h11 (AprilTags).
        paper: what it is printed on.
        dpi: pixels an inch of a PNG.
        overwrite: replace OUT.
    """

    type: BoardType
    out: Annotated[Path, RUN_ONLY] = Path("board.pdf")
    square: float | None = None
    marker: float | None = None
    dictionary: Dictionary | None = None
    paper: Paper = "a4"
    dpi: int = 300
    overwrite: Annotated[bool, RUN_ONLY, THIS_TIME] = False


def run(job: DrawBoard) -> BoardReport:
    """Draw it and write the file.

    Raises:
        UsageError: it does not fit on the paper, an unknown kind of file, or OUT is there already.
        OutputError: OUT cannot be written.
    """
    if job.out.suffix.lower() not in WRITERS:
        raise UsageError(
            f"a file named {job.out.name}", want=f"one of {', '.join(WRITERS)}", where="--out"
        )
    check_new_file(job.out, overwrite=job.overwrite)
    suffix = job.out.suffix.lower()
    check_kind(job.out, lambda head: head.startswith(BEGINS[suffix]), f"{suffix[1:].upper()} file")
    if not RESOLUTIONS[0] <= job.dpi <= RESOLUTIONS[1]:
        raise UsageError(
            f"{job.dpi} dpi", want=f"{RESOLUTIONS[0]} to {RESOLUTIONS[1]}", where="--dpi"
        )
    name = job.type.name
    square = fitting_square_m(name, job.paper) if job.square is None else job.square
    board = Board.of(name, square, marker_m=job.marker, dictionary=job.dictionary)
    sheet = sheet_of(board, job.paper)
    write_atomic(job.out, WRITERS[job.out.suffix.lower()](sheet, job.dpi))
    return BoardReport(sheet, job.out)


def _pdf(sheet: Sheet, dpi: int) -> bytes:
    del dpi
    from pseudolidar.formats.drawing.pdf import pdf_bytes

    return pdf_bytes(sheet.page)


def _svg(sheet: Sheet, dpi: int) -> bytes:
    del dpi
    from pseudolidar.formats.drawing.svg import svg_bytes

    return svg_bytes(sheet.page)


def _png(sheet: Sheet, dpi: int) -> bytes:
    from pseudolidar.formats.drawing.png import png_bytes

    return png_bytes(sheet.page, dpi)


WRITERS: dict[str, Callable[[Sheet, int], bytes]] = {".pdf": _pdf, ".svg": _svg, ".png": _png}
# First bytes of such files: what is something else is not replaced.
BEGINS = {".pdf": (b"%PDF",), ".svg": (b"<?xml", b"<svg"), ".png": (b"\x89PNG",)}


@dataclass(frozen=True, eq=False)
class BoardReport:
    """What was drawn.

    Args:
        sheet: the page.
        out: the file.
    """

    sheet: Sheet
    out: Path

    @property
    def exit_code(self) -> int:
        """0."""
        return ALL_DONE

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        board = self.sheet.board
        return {
            "board": str(board.name),
            "square_m": board.square_m,
            "marker_m": board.marker_m if board.name.kind in ("charuco", "aprilgrid") else None,
            "dictionary": board.dictionary if board.name.kind in ("charuco", "aprilgrid") else None,
            "paper": self.sheet.paper,
            "command": self.sheet.command,
            "out": str(self.out),
        }

    def text(self) -> str:
        """For people."""
        return (
            f"{self.sheet.page.title} on {self.sheet.paper}: print without scaling, measure the "
            f"rulers\nthen: {self.sheet.command}\n  {self.out}"
        )
